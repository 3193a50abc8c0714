"""What a library says, or what stands in a file, for a message of ours."""


def line(said: object) -> str:
    """Show it on one line and not at length."""
    text = " ".join(str(said).split())
    text = text if len(text) <= 300 else f"{text[:297]}..."
    return text if text.isprintable() else ascii(text)[1:-1]
