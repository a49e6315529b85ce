"""A robot on Cyclone DDS that takes what selvedge-play sends: a controller of poses, a controller of
joint trajectories, two grippers and joint states. No ROS code is in it; names, types, QoS and the
16 bytes before requests and replies are those that rmw_cyclonedds puts on the wire.

The first argument is JSON: what to do. A line `ready` is printed when all is there; when standard input
ends, one JSON object with everything that was received is printed.
"""
import json, os, signal, sys, threading, time
from cyclonedds.core import Qos, Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, float64, int8, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

told = json.loads(sys.argv[1])


def struct(name, kind, fields):
    package, sub, last = kind.split("/")
    return final(make_idl_struct(name, f"{package}.{sub}.dds_.{last}_", fields))


def message(kind):
    """A final, keyless struct with the name that ROS gives it."""
    def make(cls):
        made = struct(cls.__name__, kind, cls.__annotations__)
        globals()[cls.__name__] = made
        return made
    return make


@message("builtin_interfaces/msg/Time")
class Time: sec: int32; nanosec: uint32
@message("std_msgs/msg/Header")
class Header: stamp: Time; frame_id: str
@message("geometry_msgs/msg/PoseStamped")
class PoseStamped: header: Header; pose: array[float64, 7]
@message("geometry_msgs/msg/Point")
class Other: x: float64
@message("sensor_msgs/msg/JointState")
class JointState: header: Header; name: sequence[str]; position: sequence[float64]; velocity: sequence[float64]; effort: sequence[float64]
@message("trajectory_msgs/msg/JointTrajectoryPoint")
class Point: positions: sequence[float64]; velocities: sequence[float64]; accelerations: sequence[float64]; effort: sequence[float64]; sec: int32; nanosec: uint32
@message("trajectory_msgs/msg/JointTrajectory")
class Trajectory: header: Header; joint_names: sequence[str]; points: sequence[Point]
@message("trajectory_msgs/msg/MultiDOFJointTrajectory")
class MultiDof: header: Header; joint_names: sequence[str]; points: sequence[uint8]


def action(package, name, goal, result, feedback):
    """The five types of an action, the requests and replies with their header."""
    head = {"client": uint64, "number": int64}
    def make(suffix, fields, sub="action", pkg=package, base=name):
        return struct(base + suffix, f"{pkg}/{sub}/{base}{suffix}", fields)
    uuid = array[uint8, 16]
    return {
        "send_goal": (make("_SendGoal_Request", {**head, "id": uuid, **goal}),
                      make("_SendGoal_Response", {**head, "accepted": bool, "sec": int32, "nanosec": uint32})),
        "cancel_goal": (make("_Request", {**head, "id": uuid, "sec": int32, "nanosec": uint32}, "srv", "action_msgs", "CancelGoal"),
                        make("_Response", {**head, "code": int8, "goals": sequence[uint8]}, "srv", "action_msgs", "CancelGoal")),
        "get_result": (make("_GetResult_Request", {**head, "id": uuid}),
                       make("_GetResult_Response", {**head, "status": int8, **result})),
        "feedback": make("_FeedbackMessage", {"id": uuid, **feedback}),
    }


def qos(best_effort=False, depth=2000):
    reliability = Policy.Reliability.BestEffort if best_effort else Policy.Reliability.Reliable(duration(seconds=1))
    return Qos(reliability, Policy.History.KeepLast(depth), Policy.Durability.Volatile,
               Policy.DataRepresentation(use_cdrv0_representation=True))


domain = DomainParticipant(told["domain"])
out = {"poses": [], "frames": [], "goals": [], "cancels": 0, "arrivals": []}
lock = threading.RLock()
over = threading.Event()


def reader(name, kind): return DataReader(domain, Topic(domain, name, kind), qos())
def writer(name, kind): return DataWriter(domain, Topic(domain, name, kind), qos())


class Server:
    """An action that ends as it is told to: ok, reject, abort, silent (no reply), never (no result)."""
    def __init__(self, name, types, how, seconds, result, parse):
        self.name, self.types, self.how, self.seconds, self.result, self.parse = name, types, how, seconds, result, parse
        base = f"{name}/_action/"
        self.ends = {s: (reader(f"rq{base}{s}Request", types[s][0]), writer(f"rr{base}{s}Reply", types[s][1])) for s in ("send_goal", "cancel_goal", "get_result")}
        self.goals = {}
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not over.is_set():
            for service, (requests, replies) in self.ends.items():
                for request in requests.take(20):
                    if getattr(request, "client", None) is not None and self.how != "silent":
                        getattr(self, service)(request, replies, self.types[service][1])
            for goal in list(self.goals.values()):
                if goal["status"] == 2 and time.monotonic() > goal["end"] and self.how != "never":
                    goal["status"] = 6 if self.how == "abort" else 4
                if goal["status"] > 3:
                    for request, replies, kind in goal.pop("asked", []):
                        replies.write(kind(request.client, request.number, goal["status"], *self.result(goal, self.how)))
                    goal["asked"] = []
            time.sleep(0.002)

    def send_goal(self, request, replies, kind):
        key, ok = bytes(request.id), self.how != "reject"
        again = key in self.goals
        if ok and not again:
            seconds = self.seconds(request) if callable(self.seconds) else self.seconds
            self.goals[key] = {"status": 2, "end": time.monotonic() + seconds, "asked": [], "goal": request}
            with lock:
                out["goals"].append([self.name, self.parse(request), len(out["poses"]), key.hex()])
        replies.write(kind(request.client, request.number, ok and not again, 0, 0))

    def cancel_goal(self, request, replies, kind):
        goal = self.goals.get(bytes(request.id))
        if goal and goal["status"] == 2:
            goal["status"] = 5
            with lock: out["cancels"] += 1
        replies.write(kind(request.client, request.number, 0 if goal else 2, []))

    def get_result(self, request, replies, kind):
        goal = self.goals.get(bytes(request.id))
        if goal: goal["asked"].append((request, replies, kind))


gripper = action("control_msgs", "GripperCommand", {"position": float64, "max_effort": float64},
                 {"position": float64, "effort": float64, "stalled": bool, "reached": bool},
                 {"position": float64, "effort": float64, "stalled": bool, "reached": bool})
text = {"success": bool, "error": str}
grasp = action("franka_msgs", "Grasp", {k: float64 for k in ("width", "inner", "outer", "speed", "force")}, text, {"width": float64})
move = action("franka_msgs", "Move", {k: float64 for k in ("width", "speed")}, text, {"width": float64})
follow = action("control_msgs", "FollowJointTrajectory",
                {"trajectory": Trajectory, "multi": MultiDof, "a": sequence[uint8], "b": sequence[uint8], "c": sequence[uint8], "d": sequence[uint8], "sec": int32, "nanosec": uint32},
                {"code": int32, "text": str}, {"header": Header})

how = told.get("gripper", "ok")
servers = []
if how != "none":
    def state(goal, how): return (goal["goal"].position, 20.0, how == "stall", how != "stall")
    servers.append(Server("/gripper", gripper, how, 0.1, state, lambda r: [r.position, r.max_effort]))
    done = lambda goal, how: (how != "fail", "" if how != "fail" else "nothing between the fingers")
    servers.append(Server("/hand/grasp", grasp, how, 0.1, done, lambda r: [r.width, r.inner, r.outer, r.speed, r.force]))
    servers.append(Server("/hand/move", move, how, 0.1, done, lambda r: [r.width, r.speed]))
last = lambda r: r.trajectory.points[-1].sec + 1e-9 * r.trajectory.points[-1].nanosec
points = lambda r: [list(r.trajectory.joint_names), [[p.sec + 1e-9 * p.nanosec, *p.positions] for p in r.trajectory.points]]
servers.append(Server("/arm/follow_joint_trajectory", follow, told.get("arm", "ok"),
                      lambda r: last(r), lambda goal, how: (-4 if how == "abort" else 0, "path tolerance" if how == "abort" else ""), points))

kind = Other if told.get("wrong_type") else PoseStamped
targets = reader("rt/target_pose", kind)
joints = writer("rt/joint_states", JointState)


def publish():
    q = list(told["joints"])
    begin = time.monotonic()
    while not over.is_set():
        if time.monotonic() - begin > told.get("mute_after", 1e9):
            time.sleep(0.01)
            continue
        for server in servers:
            if server.name.startswith("/arm"):
                for goal in server.goals.values():
                    if goal["status"] == 4: q = list(goal["goal"].trajectory.points[-1].positions)
        now = time.time()
        joints.write(JointState(Header(Time(int(now), int(now % 1 * 1e9)), ""), told["names"] + ["fr3_finger_joint1"], q + [0.04], [], []))
        time.sleep(0.01)


def listen():
    while not over.is_set():
        for sample in targets.take(1000):
            if hasattr(sample, "pose"):
                with lock:
                    out["poses"].append(list(sample.pose))
                    out["arrivals"].append(time.monotonic())
                    out["frames"] = sorted({sample.header.frame_id, *out["frames"]})
        time.sleep(0.001)


def intrude():
    while len(out["poses"]) < told["second_after"] and not over.is_set(): time.sleep(0.005)
    global second
    second = writer("rt/target_pose", PoseStamped)


def leave():
    while len(out["poses"]) < told["kill_after"] and not over.is_set(): time.sleep(0.005)
    os.kill(os.getpid(), signal.SIGKILL)


for work in [publish, listen] + [intrude] * ("second_after" in told) + [leave] * ("kill_after" in told):
    threading.Thread(target=work, daemon=True).start()
print("ready", flush=True)
sys.stdin.read()
over.set()
time.sleep(0.1)
print(json.dumps(out), flush=True)
