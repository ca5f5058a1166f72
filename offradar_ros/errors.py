"""Errors whose text is one line that a user can act on.

Each message names the file, topic or parameter and says what was expected. The command line prints it and exits with
status 1; a node logs it, counts it under its cause and goes on.
"""


class OffradarError(Exception):
    """Base of every error that is the input's fault, not the program's."""


class DataError(OffradarError):
    """A file, folder or bag is missing, damaged or not what its place says."""


class ConfigError(OffradarError):
    """A parameter is unknown, of the wrong type or outside its bounds."""


class ModelError(OffradarError):
    """Encoder weights are missing, damaged, or not those that are expected."""


class MapError(OffradarError):
    """A map cannot be opened, written or used with this encoder."""


class RefusedInput(OffradarError):
    """One scan, position or embedding that is dropped; processing goes on with the next.

    `cause` is a short, stable name such as ``wrong_encoding``: the diagnostics count drops by it.
    """

    def __init__(self, cause: str, message: str) -> None:
        super().__init__(message)
        self.cause = cause
