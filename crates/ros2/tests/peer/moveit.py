"""A `move_group` with the messages of Humble or of Jazzy. It knows the joint positions along the path, for
it was told them; how it fails, too."""
from wire import *

humble = told.get("moveit_distro", "jazzy") == "humble"
how = told.get("moveit", "ok")


@message("sensor_msgs/msg/MultiDOFJointState")
class MultiDofState: header: Header; joint_names: sequence[str]; transforms: sequence[uint8]; twist: sequence[uint8]; wrench: sequence[uint8]
@message("moveit_msgs/msg/RobotState")
class RobotState: joint_state: JointState; multi_dof: MultiDofState; attached: sequence[uint8]; is_diff: bool
@message("moveit_msgs/msg/Constraints")
class Constraints: name: str; a: sequence[uint8]; b: sequence[uint8]; c: sequence[uint8]; d: sequence[uint8]
@message("moveit_msgs/msg/RobotTrajectory")
class RobotTrajectory: joint_trajectory: Trajectory; multi_dof: MultiDof


if humble:
    @message("moveit_msgs/msg/MoveItErrorCodes")
    class Code: val: int32
    def code(val): return Code(val)
    speed, names = {}, {}
else:
    @message("moveit_msgs/msg/MoveItErrorCodes")
    class Code: val: int32; message: str; source: str
    def code(val): return Code(val, "as told" if val != 1 else "", "peer")
    speed = {"velocity": float64, "acceleration": float64, "link": str, "cartesian": float64}
    names = {"controller_names": sequence[str]}

path = service("moveit_msgs/GetCartesianPath",
               {"header": Header, "start": RobotState, "group": str, "link": str, "waypoints": sequence[array[float64, 7]],
                "max_step": float64, "jump": float64, "prismatic": float64, "revolute": float64, "avoid": bool, "constraints": Constraints, **speed},
               {"start": RobotState, "solution": RobotTrajectory, "fraction": float64, "code": Code})
execute = action("moveit_msgs", "ExecuteTrajectory", {"trajectory": RobotTrajectory, **names}, {"code": Code}, {"state": str})


def nearest(pose):
    return min(told["rows"], key=lambda row: sum((a - b) ** 2 for a, b in zip(row[0], pose)))[1]


def answer(request):
    if how == "silent": return None
    with lock:
        out["calls"].append(["path", request.header.frame_id, request.group, request.link, len(request.waypoints), request.max_step, request.start.is_diff])
    joints = [list(request.start.joint_state.position)] + [nearest(pose) for pose in request.waypoints]
    fraction, val = (0.4, -31) if how == "part" else (1.0, 1)
    if how == "part": joints = joints[: len(joints) // 2]
    if how == "jump":
        joints = joints[:-1] + [[q + (0.5 if j == 3 else 0.0) for j, q in enumerate(joints[-1])]]
    if how == "off":
        joints = [[q + 0.02 for q in row] for row in joints]
    # In another order, with a time of its own, as a planner may.
    order = list(reversed(range(len(told["names"]))))
    points = [Point([row[j] for j in order], [], [], [], 3 * k, 0) for k, row in enumerate(joints)]
    trajectory = Trajectory(Header(Time(0, 0), ""), [told["names"][j] for j in order], points)
    return [request.start, RobotTrajectory(trajectory, MultiDof(Header(Time(0, 0), ""), [], [])), fraction, code(val)]


def start():
    Service("/compute_cartesian_path", path, answer)
    ended = {"ok": 1, "abort": -4}
    return Server("/execute_trajectory", execute, told.get("arm", "ok"), lambda r: last_time(r.trajectory.joint_trajectory),
                  lambda goal, how: (code(-7 if goal["status"] == 5 else ended.get(how, 1)),), lambda r: rows(r.trajectory.joint_trajectory))
