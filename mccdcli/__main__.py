"""`python -m mccdcli` is `mccd`."""

import sys

from mccdcli.main import main

sys.exit(main())
