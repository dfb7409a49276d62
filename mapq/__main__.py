"""``python -m mapq``."""

from mapq.cli import main

main()
