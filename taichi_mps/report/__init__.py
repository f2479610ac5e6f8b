"""A run for its reader: sentences, and one page.

Reads only what the run folder holds; computes nothing anew.
Read sentences.py first.
"""
