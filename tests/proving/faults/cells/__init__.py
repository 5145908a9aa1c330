"""One fault in one state of one mission, in virtual time."""
