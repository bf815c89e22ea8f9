"""`python -m swarmlab.radio FOLDER`: the radio of the lab in that folder, in the foreground."""

import sys
from pathlib import Path

from swarmlab.radio.process import run_radio
from swarmware.errors import SwarmError


def main() -> None:
    """Runs the radio; exits with the code of its error."""
    try:
        run_radio(Path(sys.argv[1]))
    except SwarmError as error:
        sys.stderr.write(f"radio: {error}\n")
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
