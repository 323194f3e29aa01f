"""Entry point of ``python -m gliderhpc``."""

from gliderhpc.cli import main

if __name__ == "__main__":
    main()
