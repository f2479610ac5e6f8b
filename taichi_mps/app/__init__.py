"""A local page of the command line: choose a test, run it, look at it, compare, calibrate.

Shows what the rooms below compute, and computes nothing itself: runs are child processes of the command line.
Read page.py first.
"""
