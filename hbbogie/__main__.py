"""Run the command line as ``python -m hbbogie``."""

from hbbogie.cli import main

if __name__ == "__main__":
    main()
