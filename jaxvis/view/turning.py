"""What a method shades with when the environment turns about +Y, without lighting it anew."""

from typing import Any

from jaxvis.lighting import Environment
from jaxvis.methods import Method
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.turning import turned_polygons, turned_surface
from jaxvis.scene import Surface


def turned(
    method: Method,
    visibility: Any,
    light: Any,
    surface: Surface,
    environment: Environment,
    yaw: float,
) -> tuple[Any, Any, Surface]:
    """(visibility, light, surface) to shade with under ``environment.rotate(yaw)``.

    Tables of polygons' lights take longer to build than to read, so there the scene turns the other
    way: the image is the same but for where directions fall in the tables' texels. Other methods'
    lights are made anew.

    Args:
        light: the method's, of ``environment`` as it is.
        yaw: radians, counter-clockwise seen from above.
    """
    if isinstance(light, PolygonLight):
        return turned_polygons(visibility, -yaw), light, turned_surface(surface, -yaw)
    return visibility, method.light(environment.rotate(yaw)), surface
