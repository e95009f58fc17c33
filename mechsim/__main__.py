"""`python -m mechsim`: the command line."""

from mechsim.cli import main

if __name__ == "__main__":
    main()
