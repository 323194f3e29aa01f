"""Studies, one a file: of a finished mission, or of twins whose truth is known."""
