"""The command line: a module for each command, and modules that do what the command prints."""
