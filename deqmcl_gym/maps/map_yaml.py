"""The YAML of a map: each key once and no aliases, so that a file says one thing in few words."""

from collections import Counter
from typing import Any

from deqmcl_gym.reading import UnreadableError

_DEEPEST = 20  # a map has 2


def yaml_of(content: bytes) -> Any:
    """Return what a YAML file holds.

    Raises:
        UnreadableError: it is no such YAML.
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
    except (yaml.YAMLError, ValueError) as error:  # no UTF-8, a 13th month
        raise UnreadableError(f"is no YAML: {' '.join(str(error).split()).rstrip('.')}") from None
