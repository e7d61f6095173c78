"""What can be wrong with one message of a bag."""


class UnusableError(ValueError):
    """A message cannot be made a reading."""
