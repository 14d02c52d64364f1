"""Services without mechanics: checks of input, files, tables, compilation, processes and interrupts."""
