"""Segments point clouds as a stream: clouds that do not fit in memory, or have not finished arriving.

`stream` is the framework as an iterator over spans; `segment` and `segment_static` return the labels of a whole cloud,
and `verify` compares them; `segment_file` and `resolve_file` go from file to file; `features` tells what the surface is
like around each point.
"""

from . import built as built  # first: it tells of a core that is not up to date
from . import scenes
from ._core import (
    ConditionalClustering,
    Dbscan,
    Plan,
    PlaneExtraction,
    Proximity,
    RadiusOutlierRemoval,
    RegionGrowing,
    Segmentor,
    SpanByCount,
    SpanByScanLine,
    SpanByTime,
    SpanByWidth,
    StatisticalOutlierRemoval,
    ThinnedSpan,
    VoxelGrid,
    Window,
    WindowPoints,
    __version__,
)
from .certificate import Certificate
from .errors import (
    FileError,
    InvalidInput,
    InvalidParameter,
    InvalidType,
    MissingExtra,
    OutputExists,
    SegmentorError,
    StreamInUse,
    StreamsegError,
    StreamsegWarning,
)
from .features import features
from .files import Outcome, resolve_file, segment_file
from .history import History
from .plan import plan
from .plugins import plugin, plugin_names
from .preprocessing import prepare, preprocess
from .preview import preview
from .run import segment, segment_static, stream
from .stream import LeftOut, Progress, Span, Stream
from .unlabelled import Unlabelled
from .verification import Verification, verify

__all__ = [
    "Certificate",
    "ConditionalClustering",
    "Dbscan",
    "FileError",
    "History",
    "InvalidInput",
    "InvalidParameter",
    "InvalidType",
    "LeftOut",
    "MissingExtra",
    "Outcome",
    "OutputExists",
    "Plan",
    "PlaneExtraction",
    "Progress",
    "Proximity",
    "RadiusOutlierRemoval",
    "RegionGrowing",
    "Segmentor",
    "SegmentorError",
    "Span",
    "SpanByCount",
    "SpanByScanLine",
    "SpanByTime",
    "SpanByWidth",
    "StatisticalOutlierRemoval",
    "Stream",
    "StreamInUse",
    "StreamsegError",
    "StreamsegWarning",
    "ThinnedSpan",
    "Unlabelled",
    "Verification",
    "VoxelGrid",
    "Window",
    "WindowPoints",
    "__version__",
    "features",
    "plan",
    "plugin",
    "plugin_names",
    "prepare",
    "preprocess",
    "preview",
    "resolve_file",
    "scenes",
    "segment",
    "segment_file",
    "segment_static",
    "stream",
    "verify",
]
