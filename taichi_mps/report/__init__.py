"""A run for its reader: sentences, and one page.

Reads only what the run folder holds; computes nothing anew. The page, report.html, carries all that it needs and opens
from the disk without a network.
Read sentences.py first, then page.py.
"""
