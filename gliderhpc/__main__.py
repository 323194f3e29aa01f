"""``python -m gliderhpc``: the program, where its script is not on the path."""

from gliderhpc.cli import main

if __name__ == "__main__":
    main()
