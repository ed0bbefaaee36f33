"""Run the command line as ``python -m hbbogie``."""

from hbbogie.commandline.main import main

if __name__ == "__main__":
    main()
