"""What is wrong, in the words that the user reads."""


class Trouble(Exception):
    """Something that the user can mend; its text says what and how."""


NO_MESH = "Select a mesh: nothing that can have wrinkles is active"
NOT_SENT = "Send the mesh first"


def changed_count(name: str, sent: int, found: int, modifiers: list[str]) -> str:
    """The vertices are no longer those that were sent."""
    text = f"'{name}' has {found} vertices, {sent} were sent: "
    if not modifiers:
        return text + "the mesh was edited; send it again"
    listed = ", ".join(f"'{modifier}'" for modifier in modifiers)
    return text + f"hide {listed} in the viewport; shown at render time only, it does no harm"


def no_answer(url: str, why: object) -> str:
    """Nobody answered."""
    return f"No answer from {url}: start it with 'rhytid serve', or set another address ({why})"


def hidden(name: str) -> str:
    """Blender does not evaluate what is disabled in viewports."""
    return (
        f"'{name}' is disabled in viewports, so that Blender does not compute its shape: enable it"
    )


def no_uv(name: str) -> str:
    """Displacement has nowhere to be."""
    return f"'{name}' has no UV map: unwrap it, for displacement is drawn in UV"


def shared(material: str) -> str:
    """One material cannot show two maps."""
    return (
        f"Material '{material}' has the wrinkles of another object: make it a single-user copy "
        "(the number beside its name), then send again"
    )
