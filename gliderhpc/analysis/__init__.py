"""Studies of a finished mission, one a file: each reads an archive and writes its own group."""
