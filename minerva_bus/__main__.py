"""`python -m minerva_bus`: the command line, where its script is not on the path."""

from minerva_bus.cli.main import main

if __name__ == "__main__":
    main()
