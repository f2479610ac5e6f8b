"""Shared code of several tests. No test imports another."""
