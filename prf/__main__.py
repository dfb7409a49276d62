"""``python -m prf``."""

from prf.cli import main

main()
