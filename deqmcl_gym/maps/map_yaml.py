"""YAML of maps: no duplicate keys, no aliases and little nesting."""

from collections import Counter
from typing import Any

from deqmcl_gym.reading import UnreadableError

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
