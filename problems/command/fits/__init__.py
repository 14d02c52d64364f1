"""The subcommands that fit measurements, one file each."""
