"""Maps as ROS' map_server reads them and map_saver writes them: a yaml file and an image.

Source: nav2_map_server, map_io.cpp; wiki.ros.org/map_server.
"""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deqmcl_gym.files import as_number, content_of, refusing, write_bytes, yaml_of
from deqmcl_gym.numerics import Floats, T
from deqmcl_gym.validation import InputError, number, one_of

Occupancy = NDArray[np.int8]

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_WHITE, _GREY, _BLACK = 254, 205, 0  # of map_saver: free, unknown, occupied
_KEPT = 8  # maps remembered
_BLOCK = 2**22  # numbers of an image in memory as float64 at a time
MAX_SIDE = 32_000  # cells: distances in cells fit 16 bits
_remembered: dict[tuple[Any, ...], Any] = {}


def remembered(
    path: str | os.PathLike[str], unknown: Any, made: Callable[[dict[str, Any]], T]
) -> T:
    """Return ``made`` of a map file, or the last result if the files have not changed."""
    yaml_path = Path(os.path.abspath(_path(path)))
    content = _document(yaml_path)
    image: Path = yaml_path.parent / content["image"]
    if not os.path.isfile(image):  # False for a name that is too long
        raise InputError(
            f"the map {yaml_path} names the image {content['image']}, but there is no file {image}."
        )
    stat = image.stat()  # the inode is another's if a link now leads elsewhere
    file = stat.st_dev, stat.st_ino, stat.st_ctime_ns, stat.st_mtime_ns, stat.st_size
    key = (yaml_path, repr(content), file, repr(unknown))
    result: T | None = _remembered.get(key)
    if result is None:
        try:
            result = made(_read(content, image))
        except InputError as error:
            raise InputError(f"the map {yaml_path}: {error}") from None
        while len(_remembered) >= _KEPT:
            _remembered.pop(next(iter(_remembered)), None)  # another thread may have done so
        _remembered[key] = result
    return result


def check_thresholds(free: Any, occupied: Any) -> None:
    """Refuse thresholds that are outside [0, 1] or not in order."""
    number("occupied_thresh", occupied, low=0, high=1, above=True)
    number("free_thresh", free, low=0, high=1)
    if free >= occupied:
        raise InputError(
            f"free_thresh is {free:g} and occupied_thresh is {occupied:g}, but free_thresh must be "
            "the smaller one."
        )


def write_map(
    path: str | os.PathLike[str],
    cells: Occupancy,
    *,
    resolution: float,
    origin: tuple[float, float, float],
    thresholds: tuple[float, float],  # of free and of occupied cells
) -> None:
    """Write a yaml file of mode "trinary" with the usual thresholds, and a pgm of its name."""
    import yaml

    yaml_path = _path(path)
    image = yaml_path.with_suffix(".pgm")
    free, occupied = thresholds
    document = {
        "image": image.name, "mode": "trinary", "resolution": float(resolution),
        "origin": [float(part) for part in origin], "negate": 0,
        "occupied_thresh": 0.65, "free_thresh": 0.196,
    }  # fmt: skip
    shares = cells[::-1] / OCCUPIED
    solid, open_ = shares >= occupied, (shares >= 0) & (shares <= free)
    pixels = np.where(solid, _BLACK, np.where(open_, _WHITE, _GREY)).astype(np.uint8)
    rows, columns = pixels.shape
    try:
        write_bytes(image, f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes())
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
        write_bytes(yaml_path, text.encode())
    except OSError as error:
        raise InputError(
            f"the map cannot be written to {yaml_path} ({error.strerror or error}): name a file in "
            "a folder that can be written to."
        ) from None


def _path(given: Any) -> Path:
    if not isinstance(given, str | os.PathLike) or not str(given).endswith((".yaml", ".yml")):
        raise InputError(f"the map file is {given!r}, but must be the path of a .yaml file.")
    return Path(os.path.expanduser(given))  # "~nobody" stays, unlike by Path.expanduser


def _document(path: Path) -> dict[str, Any]:
    """Read a yaml file; its values are checked."""
    with refusing(f"the map file {path}"):
        given = yaml_of(content_of(path))
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
    numbers = {k: as_number(given[k]) for k in ("resolution", "occupied_thresh", "free_thresh")}
    check_thresholds(numbers["free_thresh"], numbers["occupied_thresh"])
    return {
        "image": given["image"],
        "mode": one_of("mode", given.get("mode", "trinary"), ("trinary", "scale", "raw")),
        "negate": bool(negate),
        "origin": [as_number(part) for part in origin],
        **numbers,
    }


def _read(content: dict[str, Any], image: Path) -> dict[str, Any]:
    """Return the arguments of a ``GridMap``."""
    pixels = _pixels_of(image)
    rule = content["mode"], content["negate"], content["free_thresh"], content["occupied_thresh"]
    most, cells = np.iinfo(pixels.dtype).max, np.empty(pixels.shape[:2], np.int8)
    rows = max(_BLOCK // pixels[0].size, 1)  # at a time: shades take eight bytes or more
    for first in range(0, len(pixels), rows):
        part = slice(first, first + rows)
        cells[part] = _occupancy(pixels[part] / most, *rule)
    keys = ("resolution", "origin", "occupied_thresh", "free_thresh")
    return {"occupancy": cells[::-1], **{key: content[key] for key in keys}}


def _pixels_of(path: Path) -> NDArray[Any]:
    """Read the channels of an image, (h, w, c): L, RGB or RGBA in uint8, or L in uint16."""
    try:
        with _opened(path) as image:
            if max(image.size) > MAX_SIDE or image.mode == "F":
                what = f"{'x'.join(map(str, image.size))} pixels of mode {image.mode}"
                raise InputError(
                    f"the image {path} has {what}, but must have at most {MAX_SIDE:,} to a side, "
                    "of whole numbers."
                )
            plain = "RGBA" if "transparency" in image.info else "RGB"
            mode = {"P": plain, "1": "L", "LA": "RGBA"}.get(image.mode, image.mode)
            mode = "RGBA" if plain == "RGBA" and mode in ("L", "RGB") else mode
            pixels = np.asarray(image.convert(mode))
    except InputError:
        raise
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise InputError(f"the image {path} is broken: {str(error).rstrip('.')}.") from None
    values = pixels if pixels.dtype == np.uint8 else pixels.astype(np.uint16)
    return values.reshape(*pixels.shape[:2], -1)


def _opened(path: Path) -> Any:
    """Open an image by its plug-in: Pillow's own ``open`` takes a large map for an attack."""
    from PIL.BmpImagePlugin import BmpImageFile
    from PIL.PngImagePlugin import PngImageFile
    from PIL.PpmImagePlugin import PpmImageFile

    for kind in (PpmImageFile, PngImageFile, BmpImageFile):
        try:
            return kind(path)
        except SyntaxError:  # it is of another kind
            continue
    raise InputError(f"the image {path} is neither a pgm, a png nor a bmp.")


def _occupancy(shades: Floats, mode: str, negate: bool, free: float, occupied: float) -> Occupancy:
    """Return the values that map_server gives pixels, in the rows of the image."""
    channels = shades.shape[2]
    # in this mode, map_server counts alpha as a colour
    colours = channels if mode == "trinary" else min(channels, 3)
    shade = shades[:, :, :colours].mean(axis=2)
    if mode == "raw":
        value = np.rint(255 * shade)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    share = shade if negate else 1 - shade
    between: Any = UNKNOWN
    if mode == "scale":
        between = np.rint((share - free) / (occupied - free) * OCCUPIED)
    cells = np.where(share > occupied, OCCUPIED, np.where(share < free, FREE, between))
    if mode == "scale" and channels == 4:
        cells[shades[:, :, -1] < 1] = UNKNOWN
    return cells.astype(np.int8)
