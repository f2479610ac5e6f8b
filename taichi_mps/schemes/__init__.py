"""The algorithms; each composes the physical terms into one time step."""
