"""`python -m rhytid`: the same as the command `rhytid`."""

from rhytid.cli import console

if __name__ == "__main__":
    console()
