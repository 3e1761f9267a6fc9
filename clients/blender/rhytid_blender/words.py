"""What is wrong, in the words that the user reads: those that only Blender needs."""

from rhytid_client.hosts.trouble import changed_count

NO_MESH = "Select a mesh: nothing that can have wrinkles is active"


def count_changed(name: str, sent: int, found: int, modifiers: list[str]) -> str:
    """The vertices are no longer those that were sent; modifiers: those that may be why."""
    text = changed_count(name, sent, found)
    if not modifiers:
        return text + "the mesh was edited; send it again"
    listed = ", ".join(f"'{modifier}'" for modifier in modifiers)
    return text + f"hide {listed} in the viewport; shown at render time only, it does no harm"


def hidden(name: str) -> str:
    """Blender does not evaluate what is disabled in viewports."""
    return (
        f"'{name}' is disabled in viewports, so that Blender does not compute its shape: enable it"
    )


def missing_map(name: str, path: str, baked: bool) -> str:
    """The file of a map is gone."""
    how = "bake the frames again, or open their folder" if baked else "press 'Draw Now'"
    return f"The map of '{name}' is missing, its skin is smooth: {how} ({path})"


def missing_shine(name: str, path: str, baked: bool) -> str:
    """The file of a map of shine is gone."""
    how = "bake the frames again, or open their folder" if baked else "press 'Draw Now'"
    return f"The shine of '{name}' is missing, its roughness is even: {how} ({path})"


def not_kept(name: str, why: object) -> str:
    """A saved file refers to a map that will be gone."""
    return (
        f"The saved file does not have the map of '{name}', its skin will be smooth there until it "
        f"is drawn again: {why}"
    )


def copied(name: str, other: str) -> str:
    """One image cannot show two maps."""
    return f"'{name}' shows the map of '{other}': give it a material of its own, then send it"


def shared(material: str) -> str:
    """One material cannot show two maps."""
    return (
        f"Material '{material}' has the wrinkles of another object: make it a single-user copy "
        "(the number beside its name), then send again"
    )
