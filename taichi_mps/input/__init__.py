"""What people type: scenes by name, labels of their keywords and results, tool paths of printers.

No run and no file of a run.
Read catalogue.py first.
"""
