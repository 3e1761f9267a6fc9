"""What is saved with an object: how it was sent, and how its wrinkles are drawn; and the nodes that
follow its strength.

Blender as a Python module never frees this class, and so nothing that its functions know: were the
name bpy among that, Blender would not take itself down before Python, and crash after it.
"""

from typing import TYPE_CHECKING, Any

from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import Context, Image, Object, PropertyGroup

if TYPE_CHECKING:
    from rhytid_client import Method

# The node that displaces, by which our node trees are known.
HEIGHT = "rhytid height"
# With this the names of the nodes begin that a material shines by; it is that of the image.
SHINE = "rhytid shine"
METHODS = (
    ("redraw", "Redraw", "Every wrinkle drawn anew: exact"),
    ("binned", "Binned", "Precomputed maps blended: fast"),
)
RESOLUTIONS = tuple((str(1 << n), str(1 << n), f"{1 << n} texels per side") for n in range(8, 15))
UNITS = (
    ("auto", "By size", "Millimetres, centimetres or metres: whichever makes it a head"),
    ("mm", "Millimetres", ""),
    ("cm", "Centimetres", ""),
    ("dm", "Decimetres", ""),
    ("m", "Metres", ""),
    ("in", "Inches", ""),
    ("ft", "Feet", ""),
)


def _strength(properties: "RhytidProperties", context: Context) -> None:
    scale(properties.id_data)


def _shine(properties: "RhytidProperties", context: Context) -> None:
    from . import offline  # which has properties from here

    offline.switch_shine(properties.id_data)


class RhytidProperties(PropertyGroup):
    """Of one object.

    asset, vertices, udims, sent_unit: of the mesh as the server has it.  factor: mesh units in one
    of the map.  first, last: numbers of the files of an opened folder.  base: the roughness that
    the map of shine was made with, 0 where it is not known.
    """

    if TYPE_CHECKING:
        strength: float
        method: Method
        resolution: str
        unit: str
        smooth: bool
        live: bool
        folder: str
        start: int
        half: bool
        shine: bool
        lobes: bool
        roughness: float
        asset: str
        vertices: int
        udims: str
        sent_unit: str
        uv_map: str
        factor: float
        baked: bool
        pattern: str
        digits: int
        first: int
        last: int
        image: Image | None
        shine_image: Image | None
        shine_pattern: str
        base: float
    else:  # Blender reads annotations, which hold calls
        strength: FloatProperty(
            name="Strength",
            description="Factor of the displacement",
            default=1.0,
            soft_min=0.0,
            soft_max=3.0,
            update=_strength,
        )
        method: EnumProperty(name="Method", items=METHODS)
        resolution: EnumProperty(
            name="Resolution",
            description="Texels per side; counts when the mesh is sent. Fewer follow the frame "
            "faster: 2048 are a quarter of what is drawn and read for 4096",
            items=RESOLUTIONS,
            default="4096",
        )
        unit: EnumProperty(
            name="Unit",
            description="What one unit of the mesh is, without the object's scale; "
            "pores are half a millimetre apart in it",
            items=UNITS,
        )
        smooth: BoolProperty(
            name="Smooth stretch",
            description="Interpolate stretch, so that no edge of a triangle shows where it is "
            "displaced; off, maps are those of 'rhytid bake' without --sampling smooth",
            default=True,
        )
        live: BoolProperty(
            name="Update with the frame",
            description="Draw the map again when the frame changes, and before a frame is rendered",
            default=True,
        )
        folder: StringProperty(name="Folder", subtype="DIR_PATH", default="//rhytid/")
        start: IntProperty(name="First frame at", description="The frame that plays the first file")
        half: BoolProperty(
            name="Half floats", description="Half the size, within 0.05 % of each height"
        )
        shine: BoolProperty(
            name="Shine",
            description="Roughness along and across, from what relief is finer than four texels, "
            "drawn or baked with the map and connected to the Principled BSDF: for skin that is "
            "seen from afar",
            update=_shine,
        )
        lobes: BoolProperty(
            name="Two lobes",
            description="A second highlight beside that of the Principled BSDF, for the shape that "
            "relief gives it in Cycles; off, one that is up to 11 % too bright in its middle and "
            "10 % too narrow",
            default=True,
            update=_shine,
        )
        roughness: FloatProperty(
            name="Roughness",
            description="Of skin without relief, what the material has",
            default=0.35,
            min=0.01,
            max=1.0,
        )

        asset: StringProperty()
        vertices: IntProperty()
        udims: StringProperty()
        sent_unit: StringProperty()
        uv_map: StringProperty()
        factor: FloatProperty(default=1.0)
        baked: BoolProperty()
        pattern: StringProperty()
        digits: IntProperty()
        first: IntProperty()
        last: IntProperty()
        image: PointerProperty(type=Image)
        shine_image: PointerProperty(type=Image)
        shine_pattern: StringProperty()
        base: FloatProperty()

    def udim_list(self) -> list[int]:
        """The UDIMs of the map."""
        return [int(udim) for udim in self.udims.split(",") if udim]


CLASSES = (RhytidProperties,)


def ours(obj: Object) -> RhytidProperties:
    """Our properties of an object, which `register` gives to every one."""
    properties: RhytidProperties = obj.rhytid  # type: ignore[attr-defined]
    return properties


def scale(obj: Object) -> None:
    """Set the height of the displacement of an object: its strength, in the unit of the mesh."""
    for tree in trees(obj):
        tree.nodes[HEIGHT].inputs["Scale"].default_value = ours(obj).strength * ours(obj).factor


def trees(obj: Object) -> list[Any]:
    """The node trees of an object's materials that have our nodes."""
    found = [slot.material.node_tree for slot in obj.material_slots if slot.material]
    return [tree for tree in found if tree is not None and HEIGHT in tree.nodes]
