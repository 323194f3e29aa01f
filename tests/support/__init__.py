"""What tests share: missions, archives and files of known content, and second implementations."""
