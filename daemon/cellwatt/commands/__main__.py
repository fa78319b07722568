"""``python -m cellwatt.commands``: the command line without the script."""

from cellwatt.commands import main

main()
