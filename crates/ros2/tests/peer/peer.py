"""A robot that takes what selvedge-play sends: controllers of poses and of joint trajectories, servo,
move_group, grippers, and all that tells where it is.

The first argument is a file of JSON: what to do. A line `ready` is printed when all is there; when standard
input ends, one JSON object with everything that was received is printed.
"""
import os, signal
from wire import *

how = told.get("gripper", "ok")
servers = []

# Grippers.
state = {"position": float64, "effort": float64, "stalled": bool, "reached": bool}
gripper = action("control_msgs", "GripperCommand", {"position": float64, "max_effort": float64}, state, state)
parallel = action("control_msgs", "ParallelGripperCommand", {"command": JointState}, {"state": JointState, "stalled": bool, "reached": bool}, {"state": JointState})
text, width = {"success": bool, "error": str}, {"width": float64}
grasp = action("franka_msgs", "Grasp", {k: float64 for k in ("width", "inner", "outer", "speed", "force")}, text, width)
move = action("franka_msgs", "Move", {k: float64 for k in ("width", "speed")}, text, width)
follow = action("control_msgs", "FollowJointTrajectory",
                {"trajectory": Trajectory, "multi": MultiDof, "a": sequence[uint8], "b": sequence[uint8], "c": sequence[uint8], "d": sequence[uint8], "sec": int32, "nanosec": uint32},
                {"code": int32, "text": str}, {"header": Header})
homing = action("franka_msgs", "Homing", {"nothing": uint8}, text, width)
trigger = service("std_srvs/Trigger", {"nothing": uint8}, {"success": bool, "text": str})
set_bool = service("std_srvs/SetBool", {"data": bool}, {"success": bool, "text": str})
command_type = service("moveit_msgs/ServoCommandType", {"command_type": int8}, {"success": bool})

@message("std_msgs/msg/Bool")
class Bool: data: bool
@message("moveit_msgs/msg/ServoStatus")
class Status: code: int8; text: str
@message("rosgraph_msgs/msg/Clock")
class Clock: clock: Time
@message("geometry_msgs/msg/TransformStamped")
class Transform: header: Header; child: str; pose: array[float64, 7]
@message("tf2_msgs/msg/TFMessage")
class Transforms: transforms: sequence[Transform]
@message("nav_msgs/msg/Path")
class Path: header: Header; poses: sequence[PoseStamped]
@message("diagnostic_msgs/msg/KeyValue")
class KeyValue: key: str; value: str
@message("diagnostic_msgs/msg/DiagnosticStatus")
class DiagnosticStatus: level: uint8; name: str; text: str; hardware: str; values: sequence[KeyValue]
@message("diagnostic_msgs/msg/DiagnosticArray")
class Diagnostics: header: Header; status: sequence[DiagnosticStatus]


def call(name, ok):
    def answer(request):
        with lock: out["calls"].append([name, getattr(request, "data", getattr(request, "command_type", None)), len(out["poses"])])
        return None if how == "silent" and name == "close" else ok(request)
    return answer


arm_kind, gripper_kind = told.get("arm_kind", "cartesian"), told.get("gripper_kind", "gripper-command")
switched = None
if how != "none":
    def moved(goal, how): return how == "stall", how != "stall"
    done = lambda goal, how: (how != "fail", "" if how != "fail" else "nothing between the fingers")
    if gripper_kind in ("gripper-command", "parallel"):
        servers.append(Server("/gripper", gripper, how, 0.1, lambda goal, how: (goal["goal"].position, 20.0, *moved(goal, how)), lambda r: [r.position, r.max_effort]))
    if gripper_kind == "parallel":
        servers.append(Server("/parallel", parallel, how, 0.1, lambda goal, how: (goal["goal"].command, *moved(goal, how)), lambda r: [list(r.command.name), list(r.command.position), list(r.command.velocity), list(r.command.effort)]))
    if gripper_kind == "franka":
        servers += [Server("/hand/grasp", grasp, how, 0.1, done, lambda r: [r.width, r.inner, r.outer, r.speed, r.force]),
                    Server("/hand/move", move, how, told.get("jaw_seconds", 0.1), done, lambda r: [r.width, r.speed]),
                    Server("/hand/homing", homing, "ok", 0.1, done, lambda r: [])]
        Service("/hand/stop", trigger, call("stop", lambda r: (True, "")))
    if gripper_kind == "set-bool": Service("/close", set_bool, call("close", lambda r: (how != "fail", "no air" if how == "fail" else "")))
    if gripper_kind == "bool": switched = reader("rt/close", Bool)

# Arms.
if arm_kind == "joints":
    servers.append(Server("/arm/follow_joint_trajectory", follow, told.get("arm", "ok"), lambda r: last_time(r.trajectory),
                          lambda goal, how: (-4 if how == "abort" else 0, "path tolerance" if how == "abort" else ""), lambda r: rows(r.trajectory)))
if arm_kind == "moveit":
    import moveit
    servers.append(moveit.start())
# What a Franka says of itself; only mode and errors are told apart from zero.
six, inertia = {"header": Header, "six": array[float64, 6]}, {"header": Header, "ten": array[float64, 10]}
Six, Inertia = struct("Six", "geometry_msgs/msg/WrenchStamped", six), struct("Inertia", "geometry_msgs/msg/InertiaStamped", inertia)
fields = [("header", Header), ("collisions", array[float64, 26]), *[(f"j{k}", JointState) for k in range(3)], ("dd", array[float64, 14]), ("tau", JointState), ("elbow", array[float64, 10]),
          *[(f"w{k}", Six) for k in range(2)], *[(f"i{k}", Inertia) for k in range(3)], *[(f"p{k}", PoseStamped) for k in range(5)], *[(f"t{k}", Six) for k in range(3)],
          ("time", float64), ("rate", float64), ("mode", uint8), ("errors", array[bool, 72])]
FrankaState = struct("FrankaState", "franka_msgs/msg/FrankaRobotState", dict(fields))
head = Header(Time(0, 0), "base")
zero = {Header: head, JointState: JointState(head, ["a"], [0.0], [], []), Six: Six(head, [0.0] * 6), Inertia: Inertia(head, [0.0] * 10), PoseStamped: PoseStamped(head, [0.0] * 7)}


def franka_state(mode, error):
    errors = [k == error for k in range(72)]
    numbers = {"collisions": [0.0] * 26, "dd": [0.0] * 14, "elbow": [0.0] * 10, "time": 0.0, "rate": 1.0, "mode": mode, "errors": errors}
    return FrankaState(*[numbers[name] if name in numbers else zero[kind] for name, kind in fields])


franka = writer("rt/franka_robot_state", FrankaState, best_effort=True) if "franka" in told else None
prefix = told.get("prefix", "")
servo = arm_kind == "servo"
if servo:
    Service("/servo_node/switch_command_type", command_type, call("type", lambda r: (told.get("servo") != "refuse",)))
    Service("/servo_node/pause_servo", set_bool, call("pause", lambda r: (True, "")))
    status = writer("rt/servo_node/status", Status)
target = "/servo_node/pose_target_cmds" if servo else "/target_pose"
targets = reader(f"rt{prefix}{target}", Other if told.get("wrong_type") else PoseStamped)
paths, diagnostics = reader("rt/selvedge_play/planned_path", Path, kept=True), reader("rt/diagnostics", Diagnostics)
joints = writer(f"rt{prefix}/joint_states", JointState)
current, frames, fixed, clock = None, None, None, None
if "start_pose" in told:
    current = writer("rt/current_pose", PoseStamped, best_effort=True)
    frames, fixed = writer("rt/tf", Transforms), writer("rt/tf_static", Transforms, kept=True)
    fixed.write(Transforms([Transform(Header(now(), told["frame"]), "hand_tcp", [0, 0, 0.1, 0, 0, 0, 1])]))
if "clock" in told: clock = writer("rt/clock", Clock, best_effort=True)


def pose_now():
    sent = out["poses"]
    k = min(len(sent), told.get("stuck_after", 1 << 60))
    return sent[k - 1] if k else list(told["start_pose"])


def publish():
    q = list(told["joints"])
    begin = time.monotonic()
    while not over.is_set():
        since = time.monotonic() - begin
        if clock and since < told["clock"]: clock.write(Clock(Time(100 + int(since), int(since % 1 * 1e9))))
        if len(out["poses"]) >= told.get("mute_after", 1 << 60):
            time.sleep(0.01)
            continue
        for server in servers:
            for goal in server.goals.values():
                if goal["status"] == 4 and hasattr(goal["goal"], "trajectory"):
                    way = goal["goal"].trajectory
                    q = list(getattr(way, "joint_trajectory", way).points[-1].positions)
        # As far as a robot is one that always stands where it is told to.
        if "follow" in told and out["poses"]:
            at = out["poses"][-1]
            q = min(told["follow"], key=lambda row: sum((a - b) ** 2 for a, b in zip(row[0], at)))[1]
        if told.get("impossible"): q = [9.0] * len(q)
        joints.write(JointState(Header(now(), ""), told["names"] + ["fr3_finger_joint1"], q + [0.04], [], []))
        if franka: franka.write(franka_state(2, None) if len(out["poses"]) < 200 else franka_state(4, 31))
        if current:
            p = pose_now()
            current.write(PoseStamped(Header(now(), told["frame"]), p))
            # The frame between base and tip has the base at its back: only the tip matters here.
            frames.write(Transforms([Transform(Header(now(), told["frame"]), "fr3_hand_tcp", p)]))
        if servo and len(out["poses"]) >= told.get("halt_after", 1 << 60): status.write(Status(2, "close to a singularity"))
        elif servo: status.write(Status(told.get("slow", 0), ""))
        time.sleep(0.01)


known = None
if told.get("discover"):
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsSubscription
    known, out["topics"] = BuiltinDataReader(domain, BuiltinTopicDcpsSubscription), []


def listen():
    while not over.is_set():
        # Readers of others; our own are there before anybody comes.
        for sample in samples(known) if known else []:
            # One that is gone comes without a name.
            if sample.topic_name and str(sample.participant_key) != str(domain.guid):
                out["topics"].append(sample.topic_name)
        for sample in samples(targets) if targets else []:
            if hasattr(sample, "pose"):
                with lock:
                    out["poses"].append(list(sample.pose))
                    out["stamps"].append([sample.header.stamp.sec, sample.header.stamp.nanosec])
                    out["arrivals"].append(time.monotonic())
                    out["frames"] = sorted({sample.header.frame_id, *out["frames"]})
        for sample in samples(switched) if switched else []: call("close", lambda r: None)(sample)
        for sample in samples(paths): out["paths"].append([sample.header.frame_id, len(sample.poses), list(sample.poses[0].pose), list(sample.poses[-1].pose)])
        for sample in samples(diagnostics):
            for status in sample.status:
                told_now = [status.level, status.text, {v.key: v.value for v in status.values}]
                if not out["diagnostics"] or out["diagnostics"][-1][:2] != told_now[:2]: out["diagnostics"].append(told_now)
        time.sleep(0.001)


def after(key):
    while len(out["poses"]) < told[key] and not over.is_set(): time.sleep(0.002)
    return not over.is_set()


def intrude():
    global second
    if after("second_after"): second = writer("rt/target_pose", PoseStamped)


def pretend():
    global impostor
    if after("impostor_after"): impostor = writer("rt/joint_states", JointState)


def leave():
    if after("kill_after"): os.kill(os.getpid(), signal.SIGKILL)


def deaf():
    global targets
    if after("deaf_after"):
        gone, targets = targets, None
        time.sleep(0.05)
        # Dropping the object is not enough: it is known by a weak reference that is gone by then.
        gone._delete(gone._ref)


for work in [publish, listen] + [intrude] * ("second_after" in told) + [leave] * ("kill_after" in told) + [deaf] * ("deaf_after" in told) + [pretend] * ("impostor_after" in told):
    threading.Thread(target=work, daemon=True).start()
print("ready", flush=True)
sys.stdin.read()
over.set()
time.sleep(0.1)
print(json.dumps(out), flush=True)
