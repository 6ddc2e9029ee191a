"""Maps as ROS' map_server reads them and map_saver writes them: a yaml file and an image.

Source: nav2_map_server, map_io.cpp; wiki.ros.org/map_server.
"""

import io
import os
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.files import UnreadableError, content_of, write_bytes
from deqmcl_gym.numerics.types import Floats
from deqmcl_gym.validation import InputError, number, one_of, pose

_DEEPEST = 20  # a map's file has 2 levels


def yaml_of(content: bytes) -> Any:
    """Return the content of a YAML file.

    Raises:
        UnreadableError: it is not YAML, or breaks one of these rules.
    """
    import yaml

    try:
        text = content.decode("utf-8-sig")
        depth = 0
        for event in yaml.parse(text):
            if isinstance(event, yaml.AliasEvent):
                raise UnreadableError("has an alias, which no map needs")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise UnreadableError("is nested too deeply")
        node = yaml.compose(text)
        if isinstance(node, yaml.MappingNode):
            for key, count in Counter(key.value for key, _ in node.value).items():
                if count > 1:
                    raise UnreadableError(f"has the key {key!r} twice")
        return yaml.safe_load(text)
    except UnreadableError:
        raise
    except (yaml.YAMLError, ValueError) as error:  # not UTF-8, a 13th month
        raise UnreadableError(f"is not YAML: {' '.join(str(error).split()).rstrip('.')}") from None


T = TypeVar("T")
Occupancy = NDArray[np.int8]

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MODES = ("trinary", "scale", "raw")
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_WHITE, _GREY, _BLACK = 254, 205, 0  # of map_saver: free, unknown, occupied
_KEPT = 8  # maps remembered
_remembered: dict[tuple[Any, ...], Any] = {}


def remembered(
    path: str | os.PathLike[str], unknown: Any, made: Callable[[dict[str, Any]], T]
) -> T:
    """Return ``made`` of a map file, or the last result if the files have not changed."""
    yaml_path = Path(os.path.abspath(_path(path)))
    said = _document(yaml_path)
    image: Path = yaml_path.parent / said["image"]
    if not image.is_file():
        raise InputError(
            f"the map {yaml_path} names the image {said['image']}, but there is no file {image}."
        )
    stat = image.stat()
    key = (yaml_path, repr(said), stat.st_mtime_ns, stat.st_size, repr(unknown))
    found: T | None = _remembered.get(key)
    if found is None:
        try:
            found = made(_read(said, image))
        except InputError as error:
            raise InputError(f"the map {yaml_path}: {error}") from None
        while len(_remembered) >= _KEPT:
            _remembered.pop(next(iter(_remembered)), None)  # another thread may have done so
        _remembered[key] = found
    return found


def check_thresholds(free: Any, occupied: Any) -> None:
    """Refuse thresholds that are outside [0, 1] or not in order."""
    number("occupied_thresh", occupied, low=0, high=1, above=True)
    number("free_thresh", free, low=0, high=1)
    if free >= occupied:
        raise InputError(
            f"free_thresh is {free:g} and occupied_thresh is {occupied:g}, but free_thresh must be "
            "the smaller one."
        )


def write(
    path: str | os.PathLike[str],
    mode: str,
    cells: Occupancy,
    *,
    resolution: float,
    origin: tuple[float, float, float],
    thresholds: tuple[float, float],
) -> None:
    """Write a yaml file, and an image of its name beside it."""
    import yaml
    from PIL import Image

    one_of("mode", mode, MODES)
    yaml_path = _path(path)
    image = yaml_path.with_suffix(".png" if mode == "scale" else ".pgm")
    document = {
        "image": image.name, "mode": mode, "resolution": float(resolution),
        "origin": [float(part) for part in origin], "negate": 0,
        "occupied_thresh": float(thresholds[1]), "free_thresh": float(thresholds[0]),
    }  # fmt: skip
    pixels = _pixels(cells[::-1], mode, *thresholds)
    _check_kept(cells[::-1], pixels, mode, *thresholds)
    drawn = io.BytesIO()
    Image.fromarray(pixels).save(drawn, "PNG" if mode == "scale" else "PPM")
    try:
        write_bytes(image, drawn.getvalue())
        said = yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
        write_bytes(yaml_path, said.encode())
    except OSError as error:
        raise InputError(
            f"the map cannot be written to {yaml_path} ({error.strerror or error}): name a file in "
            "a folder that can be written to."
        ) from None


def _path(given: Any) -> Path:
    if not isinstance(given, str | os.PathLike) or not str(given).endswith((".yaml", ".yml")):
        raise InputError(f"the map file is {given!r}, but must be the path of a .yaml file.")
    return Path(given).expanduser()


def _document(path: Path) -> dict[str, Any]:
    """Read a yaml file; its values are checked."""
    try:
        given = yaml_of(content_of(path))
    except FileNotFoundError:
        raise InputError(f"the map file {path} does not exist: give one that does.") from None
    except UnreadableError as error:
        raise InputError(f"the map file {path} {error}.") from None
    if not isinstance(given, Mapping) or (missing := [key for key in _KEYS if key not in given]):
        what = f"has no {', '.join(missing)}" if isinstance(given, Mapping) else "is not a mapping"
        raise InputError(f"the map file {path} {what}, but needs {', '.join(_KEYS)}.")
    try:
        return _checked(given)
    except InputError as error:
        raise InputError(f"the map {path}: {error}") from None


def _checked(given: Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(given["image"], str) or not given["image"]:
        raise InputError(f"image is {given['image']!r}, but must be the path of an image.")
    negate = given["negate"]
    if negate not in (0, 1) or isinstance(negate, float):
        raise InputError(f"negate is {negate!r}, but must be 0 or 1.")
    origin = given["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise InputError(f"origin is {origin!r}, but must be [x, y, yaw].")
    said = {key: _number(given[key]) for key in ("resolution", "occupied_thresh", "free_thresh")}
    number("resolution", said["resolution"], low=0, above=True)
    check_thresholds(said["free_thresh"], said["occupied_thresh"])
    return {
        "image": given["image"],
        "mode": one_of("mode", given.get("mode", "trinary"), MODES),
        "negate": bool(negate),
        "origin": pose("origin", [_number(part) for part in origin]),
        **said,
    }


def _number(value: Any) -> Any:
    """Convert a number that PyYAML reads as text: 5e-2 is a number in YAML 1.2 and ROS only."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _read(said: dict[str, Any], image: Path) -> dict[str, Any]:
    """Return the arguments of a ``GridMap``."""
    pixels = _pixels_of(image)
    thresholds = said["free_thresh"], said["occupied_thresh"]
    cells = _occupancy(pixels, said["mode"], said["negate"], *thresholds)
    kept = ("resolution", "origin", "occupied_thresh", "free_thresh")
    return {"occupancy": cells[::-1], **{key: said[key] for key in kept}}


def _pixels_of(path: Path) -> Floats:
    """Read the channels of an image, each in [0, 1], (h, w, c): L, RGB or RGBA."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=("PPM", "PNG", "BMP")) as image:
            plain = "RGBA" if "transparency" in image.info else "RGB"
            mode = {"P": plain, "1": "L", "LA": "RGBA"}.get(image.mode, image.mode)
            pixels = np.asarray(image.convert(mode))
    except UnidentifiedImageError:
        raise InputError(f"the image {path} is neither a pgm, a png nor a bmp.") from None
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise InputError(f"the image {path} is broken: {str(error).rstrip('.')}.") from None
    most = 255 if pixels.dtype == np.uint8 else 65535
    return pixels.reshape(*pixels.shape[:2], -1) / most


def _occupancy(shades: Floats, mode: str, negate: bool, free: float, occupied: float) -> Occupancy:
    """Return the values that map_server gives pixels, in the rows of the image."""
    channels = shades.shape[2]
    opaque = shades[:, :, -1] == 1 if channels == 4 else np.True_
    # in this mode, map_server counts alpha as a colour
    colours = channels if mode == "trinary" else min(channels, 3)
    shade = shades[:, :, :colours].mean(axis=2)
    if mode == "raw":
        value = np.rint(255 * shade)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    share = shade if negate else 1 - shade
    between = np.full(share.shape, float(UNKNOWN))
    if mode == "scale":
        scaled = np.rint((share - free) / (occupied - free) * OCCUPIED)
        between = np.where(opaque, scaled, UNKNOWN)
    cells = np.where(share > occupied, OCCUPIED, np.where(share < free, FREE, between))
    if mode == "scale":
        cells = np.where(opaque, cells, UNKNOWN)
    return cells.astype(np.int8)


def _check_kept(
    cells: Occupancy, pixels: NDArray[np.uint8], mode: str, free: float, occupied: float
) -> None:
    """Refuse pixels in which solid cells or free ones would be read back as something else.

    A white pixel is 254 of 255, so free cells need a ``free`` above 0.004, solid ones an
    ``occupied`` below 1.
    """
    grey_as_rgb = pixels[..., [0, 0, 0, 1]] if pixels.ndim == 3 else pixels[..., None]
    back = _occupancy(grey_as_rgb / 255, mode, False, free, occupied)
    was_solid, is_solid = (values / OCCUPIED >= occupied for values in (cells, back))
    was_free = (cells >= FREE) & (cells / OCCUPIED <= free)
    if (was_solid & ~is_solid).any() or (was_free & (is_solid | (back < FREE))).any():
        raise InputError(
            f"mode is {mode!r}, in which cells would change from free or occupied to another kind "
            f'with free_thresh = {free:g} and occupied_thresh = {occupied:g}: choose mode="raw", '
            "or other thresholds."
        )


def _pixels(cells: Occupancy, mode: str, free: float, occupied: float) -> NDArray[np.uint8]:
    """Return the image that map_saver makes of cells."""
    if mode == "raw":
        return cells.astype(np.uint8)  # -1 becomes 255
    if mode == "trinary":
        between = 1 - (free + occupied) / 2
        grey = _GREY if free <= 1 - _GREY / 255 <= occupied else round(255 * between)
        shares = cells / OCCUPIED
        solid, open_ = shares >= occupied, (cells >= FREE) & (shares <= free)
        return np.where(solid, _BLACK, np.where(open_, _WHITE, grey)).astype(np.uint8)
    share = free + cells / OCCUPIED * (occupied - free)
    shade = np.rint(255 * (1 - share))
    shade = np.where(cells == FREE, _WHITE, np.where(cells == OCCUPIED, _BLACK, shade))
    alpha = np.where(cells == UNKNOWN, 0, 255)
    return np.stack([shade, alpha], axis=2).astype(np.uint8)
