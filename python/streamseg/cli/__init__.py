"""The command line: segment, verify, resolve, info, preview, export, demo."""

import signal

# Ctrl-C while modules are loaded ends the process at once, without a traceback.
_on_ctrl_c = signal.getsignal(signal.SIGINT)
if _on_ctrl_c is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from .commands import app, main  # noqa: E402

if _on_ctrl_c is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.default_int_handler)

__all__ = ["app", "main"]
