"""The text of Coq files as tests read it."""


def bare(text: str) -> str:
    """The text without its comments."""
    out: list[str] = []
    depth = place = 0
    while place < len(text):
        two = text[place : place + 2]
        if two == "(*":
            depth, place = depth + 1, place + 2
        elif two == "*)":
            depth, place = depth - 1, place + 2
            assert depth >= 0
        else:
            out += [text[place]] if depth == 0 else []
            place += 1
    assert depth == 0
    return "".join(out)
