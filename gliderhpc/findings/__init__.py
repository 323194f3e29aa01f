"""What a study finds: tables, figures and comparisons with the paper, and the files that they go to."""
