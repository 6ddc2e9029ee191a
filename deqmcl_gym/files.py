"""Files: untrusted ones read, own ones written.

Reading never blocks, sizes are limited, contents are checked. A file is written whole or not at
all.
"""

import errno
import gzip
import io
import json
import os
import secrets
import shlex
import stat
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn

import msgspec

from deqmcl_gym.numerics import T
from deqmcl_gym.validation import InputError

PREFIX, SUFFIX = ".deqmcl-", ".tmp"  # of the temporary file that an interrupted write leaves


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: first to a temporary file beside it, then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{PREFIX}{secrets.token_hex(4)}{SUFFIX}")
    try:
        with beside.open("xb") as file:  # with the permissions of the umask
            file.write(content)
            file.flush()
            os.fsync(file.fileno())  # or a power cut could leave an empty file
        beside.replace(path)
    except BaseException as error:
        with suppress(OSError):
            beside.unlink()
        if isinstance(error, OSError):
            error.filename = str(path)  # for a full disk, Python names no file
        raise


MOST_BYTES = 2**26  # far above any file of ours
MOST_OF_LOGS = 2**30  # bytes, unpacked
_DEEPEST = 20  # levels of a YAML file


class UnreadableError(ValueError):
    """Why a file cannot be used: the rest of a sentence that begins with its name."""


@contextmanager
def opened(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file, without waiting for a pipe."""
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        raise
    except OSError as error:
        raise UnreadableError(f"cannot be read ({error.strerror})") from None
    except ValueError:  # a name with a null character
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from None
    kind = stat.S_IFMT(os.fstat(handle).st_mode)
    if kind != stat.S_IFREG:
        os.close(handle)
        named = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe"}
        raise UnreadableError(f"is {named.get(kind, 'a device or a socket')}")
    with os.fdopen(handle, "rb") as file:
        try:
            yield file
        except OSError as error:
            raise UnreadableError(f"cannot be read ({error.strerror or error})") from None


@contextmanager
def refusing(named: str | Path) -> Iterator[None]:
    """Refuse in a sentence a file that is not there, or that cannot be used."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{named} does not exist: give a file that does.") from None
    except UnreadableError as error:
        raise InputError(f"{named} {error}: give another file.") from None


def content_of(path: Path) -> bytes:
    """Return the bytes of a regular file of at most ``MOST_BYTES``."""
    with opened(path) as file:
        return at_most(MOST_BYTES, file)


def at_most(most: int, file: IO[bytes] | gzip.GzipFile) -> bytes:
    """Return the rest of a file, unpacked if ``file`` unpacks, of at most so many bytes."""
    parts, left = [], most + 1
    while left and (part := file.read(min(left, 2**20))):
        parts.append(part)
        left -= len(part)
    if not left:
        raise UnreadableError(f"is larger than {most:,} bytes, the most that is read")
    return b"".join(parts)


def json_of(content: bytes) -> dict[str, Any]:
    """Return the JSON object in a file's content."""
    try:
        text = content.decode()
        value = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_once)
    except UnreadableError:
        raise
    except UnicodeDecodeError:
        raise UnreadableError("cannot be read (it is not UTF-8)") from None
    except ValueError:
        raise UnreadableError("is truncated, or not JSON") from None
    except RecursionError:
        raise UnreadableError("is nested too deeply") from None
    if not isinstance(value, dict):
        raise UnreadableError("is not a JSON object")
    return value


def yaml_of(content: bytes, build: Callable[[Any], Any] | None = None) -> Any:
    """Return the content of a YAML file, made by ``build`` of PyYAML's node if that is given."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast, if it is there
    try:
        text = content.decode("utf-8-sig")
        depth = 0
        for event in yaml.parse(text, loader):
            if isinstance(event, yaml.AliasEvent):
                raise UnreadableError("has an alias, which is not taken (write its values out)")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise UnreadableError("is nested too deeply")
        node = yaml.compose(text, loader)
        if build is not None:
            return build(node)
        if isinstance(node, yaml.MappingNode):
            for key, count in Counter(str(key.value) for key, _ in node.value).items():
                if count > 1:
                    raise UnreadableError(f"has the key {key!r} twice")
        return yaml.load(text, loader)
    except UnreadableError:
        raise
    except (yaml.YAMLError, ValueError) as error:  # not UTF-8, a 13th month
        raise UnreadableError(f"is not YAML: {' '.join(str(error).split()).rstrip('.')}") from None


def as_number(value: Any) -> Any:
    """Convert a number that PyYAML reads as text: 5e-2 is a number in YAML 1.2 and ROS only."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def typed(value: Any, kind: type[T]) -> T:
    """Return a JSON value as a type whose fields describe its shape; more fields may be there."""
    try:
        return msgspec.convert(value, kind, str_keys=True)
    except msgspec.ValidationError as error:
        message = str(error).replace("`", "").replace(" - at $.", " at ").removesuffix(" - at $")
        raise UnreadableError(f"has the wrong form ({message[:1].lower()}{message[1:]})") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        twice, _ = Counter(name for name, _ in pairs).most_common(1)[0]
        raise UnreadableError(f"has the name {twice!r} twice")
    return mapping


def _refuse_constant(name: str) -> NoReturn:
    raise UnreadableError(f"contains {name}, which is not a number")


def save(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; compressed if its name ends in .gz."""
    packed = path.suffix.lower() == ".gz"
    try:
        write_bytes(path, gzip.compress(content, mtime=0) if packed else content)
    except OSError as error:
        sentence = f"{path} cannot be written ({error.strerror}): give another path."
        raise InputError(sentence) from None


def text_of(path: Path) -> str:
    """Return the text of a file, decompressed if it is gzip, else refuse it.

    Bytes that are not UTF-8 become U+FFFD, so that they damage their line only.
    """
    with refusing(path), opened(path) as file:
        packed = at_most(MOST_OF_LOGS, file)
        if packed[:2] == b"\x1f\x8b":  # gzip
            try:
                packed = at_most(MOST_OF_LOGS, gzip.GzipFile(fileobj=io.BytesIO(packed)))
            except (EOFError, zlib.error, OSError) as error:
                damaged = f"is a truncated or damaged gzip file ({error})"
                raise InputError(f"{path} {damaged}: fetch it again.") from None
    if packed[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return packed.decode("utf-16", errors="replace")
    if b"\0" in packed[:4096]:
        raise InputError(f"{path} is binary, but must be text: check the ending of its name.")
    return packed.decode("utf-8-sig", errors="replace")


def numbers_of(words: list[str]) -> list[float]:
    """Return words as numbers, NaN and inf among them; ValueError for others, and for "1_000"."""
    if any("_" in word for word in words):
        raise ValueError("an underscore")
    return [float(word) for word in words]


def columns_of(
    path: Path, columns: Sequence[str], needed: Sequence[str], optional: Sequence[str]
) -> list[int]:
    """Return where a table has the needed columns and, if any of these, the optional ones."""
    asked = [*needed, *(optional if {*optional} & {*columns} else ())]
    for name in asked:
        if (count := columns.count(name)) != 1:
            raise InputError(
                f"{path} has the column {name!r} {count} times, but must have {','.join(needed)} "
                f"and all or none of {','.join(optional)}, each once."
            )
    return [columns.index(name) for name in asked]


def writable_folder(path: Path) -> Path:
    """Make a folder if it is missing; refuse one that cannot be written to."""
    named = f"the output folder {path}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{named} is a file, or is inside one: give a folder.") from None
    except OSError as error:
        why = f"cannot be written to ({error.strerror})"
        raise InputError(f"{named} {why}: give another one.") from None


def is_temporary(path: Path) -> bool:
    """Whether a file is what an interrupted write of ours has left."""
    named = path.name.startswith(PREFIX) and path.suffix == SUFFIX
    return named and path.is_file() and not path.is_symlink()


def utf8(text: str) -> bytes:
    r"""Encode a text; a byte of a file name that is no UTF-8 as ``\udc…``."""
    return text.encode(errors="backslashreplace")


def command_line(words: Sequence[str]) -> str:
    r"""Quote words for a shell, on one line of text; bytes that are no UTF-8 as ``$'\xe9'``."""
    return " ".join(map(_quoted, words))


def _quoted(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    plain, content = {*range(32, 127)} - {*b"'\\"}, word.encode(errors="surrogateescape")
    escaped = (chr(byte) if byte in plain else f"\\x{byte:02x}" for byte in content)
    return f"$'{''.join(escaped)}'"


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode())
