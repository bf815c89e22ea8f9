"""Entry point of `python -m swarmctl`."""

import sys

from swarmctl.main import main

sys.exit(main())
