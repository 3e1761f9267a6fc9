"""`python -m rhytid`: the same as the command `rhytid`."""

import sys

from rhytid.cli import main

if __name__ == "__main__":
    sys.exit(main())
