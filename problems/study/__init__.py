"""The study of the paper, from its embedded data to its tables and figures."""
