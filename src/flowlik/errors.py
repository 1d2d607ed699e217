"""The library's own exceptions: every complaint about input is one of these, in one line."""


class FlowlikError(Exception):
    """Base of all errors raised on purpose by flowlik; its message is one line.

    Parameters
    ----------
    message : str
        What was found, where, and what was expected. A line break in it, as a file's name or content may
        hold, becomes a backslash and an n.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__("\\n".join(str(message).splitlines()))


class DataError(FlowlikError):
    """An input (image, flow, depth, pose, file) is missing, unreadable, or of the wrong shape."""


class MissingFieldError(DataError):
    """A data set does not have the field asked for, such as poses or depth."""


class ModelError(FlowlikError):
    """A likelihood file is invalid, or was made for another flow method or texture definition."""


class CalibrationError(FlowlikError):
    """A likelihood could not be calibrated from the data given."""


class MissingExtraError(FlowlikError):
    """A package that an extra brings is not installed."""
