"""The window of the project: watch a network learn one mesh, choose the step to keep, save it.

Layers, each of which knows only those to its left: ``model`` (the workspace, plain Python) <- ``views`` (widgets with narrow
setters and signals) and ``runner`` (the training thread) <- ``controller`` (the only place that wires them) <- ``app``.
"""

import os

# qtpy and pyqtgraph choose a binding on import; anything else than the one that is installed with this package would fail.
os.environ.setdefault("QT_API", "pyside6")
