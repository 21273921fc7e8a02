"""Slow, readable twins of the core, to be read beside the papers."""
