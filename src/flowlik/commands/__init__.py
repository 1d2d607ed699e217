"""The commands as Python functions of the same names; the command line only parses and prints."""
