"""What ROS 2 puts on the wire, on Cyclone DDS: names, types, QoS, and the 16 bytes before requests and
replies that rmw_cyclonedds has. No ROS code is in it."""
import json, sys, threading, time
from cyclonedds.core import Qos, Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, float64, int8, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

told = json.load(open(sys.argv[1]))
domain = DomainParticipant(told["domain"])
over = threading.Event()
lock = threading.RLock()
# What was received.
out = {"poses": [], "stamps": [], "frames": [], "goals": [], "cancels": 0, "arrivals": [], "calls": [], "paths": [], "diagnostics": []}


def struct(name, kind, fields):
    package, sub, last = kind.split("/")
    return final(make_idl_struct(name, f"{package}.{sub}.dds_.{last}_", fields))


def message(kind):
    """A final, keyless struct with the name that ROS gives it."""
    def make(cls):
        made = struct(cls.__name__, kind, cls.__annotations__)
        sys.modules[cls.__module__].__dict__[cls.__name__] = made
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


def now():
    t = time.time()
    return Time(int(t), int(t % 1 * 1e9))


def qos(best_effort=False, depth=2000, kept=False):
    reliability = Policy.Reliability.BestEffort if best_effort else Policy.Reliability.Reliable(duration(seconds=1))
    return Qos(reliability, Policy.History.KeepLast(depth), Policy.Durability.TransientLocal if kept else Policy.Durability.Volatile,
               Policy.DataRepresentation(use_cdrv0_representation=True))


def reader(name, kind, **more): return DataReader(domain, Topic(domain, name, kind), qos(**more))
def writer(name, kind, **more): return DataWriter(domain, Topic(domain, name, kind), qos(**more))
def samples(of): return [s for s in of.take(1000) if not type(s).__name__.startswith("Invalid")]


HEAD = {"client": uint64, "number": int64}


def service(kind, request, reply):
    """The two types of a service with their headers."""
    package, name = kind.split("/")
    return (struct(name + "_Request", f"{package}/srv/{name}_Request", {**HEAD, **request}),
            struct(name + "_Response", f"{package}/srv/{name}_Response", {**HEAD, **reply}))


def action(package, name, goal, result, feedback):
    """The types of an action."""
    uuid = array[uint8, 16]
    def make(suffix, fields): return struct(name + suffix, f"{package}/action/{name}{suffix}", fields)
    return {
        "send_goal": (make("_SendGoal_Request", {**HEAD, "id": uuid, **goal}),
                      make("_SendGoal_Response", {**HEAD, "accepted": bool, "sec": int32, "nanosec": uint32})),
        "cancel_goal": service("action_msgs/CancelGoal", {"id": uuid, "sec": int32, "nanosec": uint32}, {"code": int8, "goals": sequence[uint8]}),
        "get_result": (make("_GetResult_Request", {**HEAD, "id": uuid}),
                       make("_GetResult_Response", {**HEAD, "status": int8, **result})),
        "feedback": make("_FeedbackMessage", {"id": uuid, **feedback}),
    }


class Service:
    """Answers with what `answer` makes of a request; nothing, and it stays silent."""
    def __init__(self, name, types, answer):
        requests, replies = reader(f"rq{name}Request", types[0]), writer(f"rr{name}Reply", types[1])
        def run():
            while not over.is_set():
                for request in samples(requests):
                    reply = answer(request)
                    if reply is not None: replies.write(types[1](request.client, request.number, *reply))
                time.sleep(0.004)
        threading.Thread(target=run, daemon=True).start()


class Server:
    """An action that ends as it is told to: ok, reject, abort, stall, silent (no reply), never (no result)."""
    def __init__(self, name, types, how, seconds, result, parse):
        self.name, self.types, self.how, self.seconds, self.result, self.parse = name, types, how, seconds, result, parse
        base = f"{name}/_action/"
        self.ends = {s: (reader(f"rq{base}{s}Request", types[s][0]), writer(f"rr{base}{s}Reply", types[s][1])) for s in ("send_goal", "cancel_goal", "get_result")}
        self.feedback = writer(f"rt{base}feedback", types["feedback"])
        self.goals = {}
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not over.is_set():
            for service, (requests, replies) in self.ends.items():
                for request in samples(requests):
                    if self.how != "silent": getattr(self, service)(request, replies, self.types[service][1])
            for goal in list(self.goals.values()):
                if goal["status"] == 2 and time.monotonic() > goal["end"] and self.how != "never":
                    goal["status"] = 6 if self.how == "abort" else 4
                if goal["status"] > 3:
                    for request, replies, kind in goal["asked"]:
                        replies.write(kind(request.client, request.number, goal["status"], *self.result(goal, self.how)))
                    goal["asked"] = []
            time.sleep(0.004)

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


def last_time(trajectory): return trajectory.points[-1].sec + 1e-9 * trajectory.points[-1].nanosec
def rows(trajectory): return [list(trajectory.joint_names), [[p.sec + 1e-9 * p.nanosec, *p.positions] for p in trajectory.points]]
