"""Records and run folders: what every command leaves."""
