"""The command line: segment, verify, resolve, info, preview, export, demo."""

from .commands import app, main

__all__ = ["app", "main"]
