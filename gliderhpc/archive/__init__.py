"""Reading an archive: opening it, one profile's data, and how its studies were made."""
