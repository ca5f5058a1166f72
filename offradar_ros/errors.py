"""Errors whose text is one line that a user can act on.

Each message names the file, topic or parameter and says what was expected. The command line prints it and exits with
status 1; a node logs it, counts it by its cause and continues.
"""

LONGEST_REFUSAL = 4000
"""Most characters of a refusal: the rest, in its middle, is left out."""


class OffradarError(Exception):
    """Base of all errors that are caused by input, not by a defect of the program."""


class DataError(OffradarError):
    """A file, folder or bag is missing, damaged or of another format."""


class ConfigError(OffradarError):
    """A parameter is unknown, of the wrong type or outside its bounds."""


class ModelError(OffradarError):
    """Weights of an encoder are missing, damaged or of another model."""


class MapError(OffradarError):
    """A map cannot be opened, written or used with this encoder."""


class RefusedInput(OffradarError):
    """One scan, position or embedding that is dropped; processing continues with the next.

    `cause` is a short, stable name such as ``wrong_encoding``, by which diagnostics count dropped inputs.
    """

    def __init__(self, cause: str, message: str) -> None:
        # It may repeat what a message held, which is of any length.
        middle = len(message) - LONGEST_REFUSAL
        half = LONGEST_REFUSAL // 2
        super().__init__(message if middle <= 0 else f'{message[:half]} … {message[-half:]}')
        self.cause = cause
