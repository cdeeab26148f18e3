"""What a reader must refuse."""


class Bad(Exception):
    """What a reader must refuse."""


def need(condition, what):
    if not condition:
        raise Bad(what)
