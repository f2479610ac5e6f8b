"""The command line: options, commands, what a terminal shows.

Nothing that a script could not do with the package.
Read main.py first.
"""
