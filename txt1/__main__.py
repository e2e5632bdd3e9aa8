"""``python -m txt1``."""

from txt1.cli import main

if __name__ == "__main__":
    main()
