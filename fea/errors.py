"""The one error that mechanics raises when an analysis is impossible or its answer unusable."""


class FeaError(Exception):
    """An analysis cannot be set up or solved.

    The message is one sentence: what was wrong, the value, the limit, and the remedy.
    """
