"""The exceptions of toothprep."""


class Error(Exception):
    """The work could not be done; str() is a complete sentence.

    For input that is not acceptable its parts are there as well, each a text that may be empty:

    file       the file or argument
    place      the field, dataset or line in it
    condition  what is wrong
    remedy     what to do
    """

    def __init__(self, text="", file="", place="", condition="", remedy=""):
        super().__init__(text, file, place, condition, remedy)
        self.file = file
        self.place = place
        self.condition = condition
        self.remedy = remedy

    def __str__(self):
        """The sentence."""
        return self.args[0]


class SizeError(Error, MemoryError):
    """A dense copy would take more memory than is free or allowed. Nothing was allocated."""
