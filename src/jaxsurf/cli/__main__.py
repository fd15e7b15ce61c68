"""`python -m jaxsurf.cli`, where the script is not on the path."""

from jaxsurf.cli import main

main()
