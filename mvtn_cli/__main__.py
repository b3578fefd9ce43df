"""`python -m mvtn_cli` is `mvtn`."""

from mvtn_cli.app import main

if __name__ == "__main__":
    main()
