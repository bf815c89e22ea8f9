"""`python -m swarmd` is `swarmd`."""

import sys

from swarmd.main import main

sys.exit(main())
