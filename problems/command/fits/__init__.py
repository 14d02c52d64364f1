"""The subcommands that estimate something from measurements, one file each."""
