"""Reads a bag with PyPI's mcap and decodes its messages by the definitions inside it, with rosbags. Prints a
JSON list: topic, type, time, and what is in it."""
import json, sys
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store, seen, out = get_typestore(Stores.EMPTY), set(), []


def plain(value):
    if hasattr(value, "__dict__"): return {k: plain(v) for k, v in vars(value).items() if not k.startswith("_")}
    if hasattr(value, "tolist"): return value.tolist()
    return [plain(v) for v in value] if isinstance(value, list) else value


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    assert reader.get_header().profile == "ros2"
    for schema, channel, message in reader.iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        if schema.name not in seen:
            seen.add(schema.name)
            store.register({k: v for k, v in get_types_from_msg(schema.data.decode(), schema.name).items() if k not in store.fielddefs})
        decoded = plain(store.deserialize_cdr(message.data, schema.name))
        out.append([channel.topic, schema.name, message.log_time, decoded])
print(json.dumps(out))
