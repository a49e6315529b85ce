"""Encodes messages by the definitions in `interfaces.txt`, with PyPI's rosbags: no two numbers or strings in
one are alike. The first argument is the distribution. Prints one JSON object: for each message its bytes and
its leaves, names and values in order; and the type hashes, ours and those that rosbags knows.
"""
import json, os, sys
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

distro = sys.argv[1]
store, known = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_JAZZY if distro == "jazzy" else Stores.ROS2_HUMBLE)
# Lists of these are always empty here.
LEFT = {"moveit_msgs/msg/Left", "control_msgs/msg/JointTolerance", "control_msgs/msg/JointComponentTolerance",
        "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", "geometry_msgs/msg/Transform", "geometry_msgs/msg/Twist", "geometry_msgs/msg/Wrench"}

texts, parts = {}, {"srv": ("_Request", "_Response"), "action": ("_Goal", "_Result", "_Feedback")}
for line in open(os.path.join(os.path.dirname(__file__), "interfaces.txt")):
    line = line.rstrip()
    if line.startswith("#"): continue
    if line.startswith("= "):
        (package, kind, name), part = line[2:].split("/"), 0
    elif line == "---": part += 1
    elif not line.startswith("@") or line.startswith(f"@{distro} "):
        suffix = parts[kind][part] if kind in parts else ""
        texts[f"{package}/msg/{name}{suffix}"] = texts.get(f"{package}/msg/{name}{suffix}", "") + line.split(f"@{distro} ")[-1] + "\n"
types = {}
for name, text in texts.items(): types.update(get_types_from_msg(text, name))
store.register(types)
count = 0


def scalar(kind):
    global count
    count += 1
    if kind in ("float64", "float32"): return count + 0.25
    if kind == "bool": return count % 3 == 0
    if kind == "string": return f"text {count}"
    return count % 100


def make(node, leaves, name):
    """A value of a field; nodes are those of rosbags: 1 base, 2 name, 3 array, 4 sequence."""
    kind, detail = int(node[0]), node[1]
    if kind == 1:
        value = scalar(detail[0] if isinstance(detail, tuple) else detail)
        leaves.append([name, value])
        return value
    if kind == 2: return struct(detail, leaves)
    inner, length = detail
    if kind == 4: length = 0 if int(inner[0]) == 2 and inner[1] in LEFT else 2
    values = [make(inner, leaves, name) for _ in range(length)]
    if int(inner[0]) == 1:
        import numpy
        base = inner[1][0] if isinstance(inner[1], tuple) else inner[1]
        if base != "string": return numpy.array(values, dtype=base if base != "bool" else "bool")
    return values


def struct(name, leaves):
    constants, fields = store.fielddefs[name]
    return store.types[name](**{field: make(node, leaves, field) for field, node in fields})


messages = {}
for name in texts:
    count, leaves = 0, []
    value = struct(name, leaves)
    messages[name] = [bytes(store.serialize_cdr(value, name))[4:].hex(), leaves]
def hashes(of): return {name: of.hash_rihs01(name) for name in texts if name in of.fielddefs and not name.startswith("moveit_msgs")}
print(json.dumps({"messages": messages, "ours": hashes(store), "known": hashes(known)}))
