"""The dashboard as a page for the browsers of this machine."""
