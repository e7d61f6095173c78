"""A robot that navigates by itself: the action NavigateToPose of Nav2, without ROS and obstacles.

    python nav2.py

It drives straight to each goal at 1 m/s and tells how it goes. A later goal replaces an earlier
one, goals outside of a square of 20 m are rejected, and the others can be canceled.
"""

import argparse
import math
import signal
import threading
import time

import numpy as np
from node import Ros, get_types_from_msg, make, pose, read, reply, store

ACTION = "nav2_msgs/action/NavigateToPose"
MESSAGES = {
    "SendGoal_Request": "unique_identifier_msgs/UUID goal_id\ngeometry_msgs/PoseStamped pose\n"
    "string behavior_tree",
    "SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
    "GetResult_Request": "unique_identifier_msgs/UUID goal_id",
    "GetResult_Response": "int8 status\nuint16 error_code\nstring error_msg",
    "CancelGoal_Request": "action_msgs/GoalInfo goal_info",
    "CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
    "FeedbackMessage": "unique_identifier_msgs/UUID goal_id\n"
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
    "float32 distance_remaining\nfloat32 position_tracking_error\nfloat32 heading_tracking_error",
}
types = {}
for part, text in MESSAGES.items():
    types |= get_types_from_msg(text, f"{ACTION}_{part}")
store.register(types)

UNKNOWN, REACHED, CANCELED, ABORTED = 0, 4, 5, 6


class Navigation(Ros):
    """An action server with one goal at a time, as that of Nav2."""

    def __init__(self, listen="tcp/127.0.0.1:7447", speed=1.0):
        super().__init__(listen, 0)
        self.x = self.y = 0.0
        self.speed = speed
        self.goal = None  # its id, x and y
        self.ended = {}  # states by id
        self.asked = []  # queries for results, with ids
        self.lock = threading.RLock()
        name = "navigate_to_pose/_action"
        self.advertise(f"{name}/feedback", f"{ACTION}_FeedbackMessage")
        self.serve(f"{name}/send_goal", f"{ACTION}_SendGoal", self.on_goal)
        self.serve(f"{name}/get_result", f"{ACTION}_GetResult", self.on_result)
        self.serve(f"{name}/cancel_goal", "action_msgs/srv/CancelGoal", self.on_cancel)

    def on_goal(self, query):
        request = read(query, f"{ACTION}_SendGoal_Request")
        at = request.pose.pose.position
        accepted = abs(at.x) <= 10 and abs(at.y) <= 10
        with self.lock:
            if accepted:
                self.end(ABORTED)  # a later goal preempts the earlier one
                self.goal = bytes(request.goal_id.uuid), at.x, at.y
                print(f"goal {at.x:.2f} {at.y:.2f}", flush=True)
            stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
            reply(query, f"{ACTION}_SendGoal_Response", accepted=accepted, stamp=stamp)

    def on_result(self, query):
        goal = bytes(read(query, f"{ACTION}_GetResult_Request").goal_id.uuid)
        with self.lock:
            self.asked.append((query, goal))
            self.answer()

    def on_cancel(self, query):
        about = read(query, f"{ACTION}_CancelGoal_Request").goal_info
        goal = bytes(about.goal_id.uuid)
        with self.lock:
            runs = self.goal is not None and self.goal[0] == goal
            code = 0 if runs else 3 if goal in self.ended else 2
            kind = f"{ACTION}_CancelGoal_Response"
            reply(query, kind, return_code=code, goals_canceling=[about] if runs else [])
            if runs:
                self.end(CANCELED)

    def end(self, state):
        """End the goal, if there is one."""
        if self.goal is not None:
            self.ended[self.goal[0]] = state
            self.goal = None
            print({REACHED: "reached", CANCELED: "canceled", ABORTED: "aborted"}[state], flush=True)
            self.answer()

    def answer(self):
        """Answer those who wait for results; a goal that is not known has none."""
        waiting = []
        for query, goal in self.asked:
            if self.goal is not None and goal == self.goal[0]:
                waiting.append((query, goal))
            else:
                self.tell_result(query, self.ended.get(goal, UNKNOWN))
        self.asked = waiting

    def tell_result(self, query, state):
        kind = f"{ACTION}_GetResult_Response"
        reply(query, kind, status=state, error_code=0, error_msg="")

    def drive(self, seconds):
        """Drive for a time, and tell how it goes."""
        with self.lock:
            if self.goal is None:
                return
            goal, x, y = self.goal
            left = math.hypot(x - self.x, y - self.y)
            part = min(1.0, self.speed * seconds / left) if left else 1.0
            self.x, self.y = self.x + part * (x - self.x), self.y + part * (y - self.y)
            self.publish(
                "navigate_to_pose/_action/feedback", self.feedback(goal, left * (1 - part))
            )
            if part == 1.0:
                self.end(REACHED)

    def feedback(self, goal, left):
        duration = make("builtin_interfaces/msg/Duration", sec=int(left / self.speed), nanosec=0)
        stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        header = make("std_msgs/msg/Header", stamp=stamp, frame_id="map")
        return make(
            f"{ACTION}_FeedbackMessage",
            goal_id=make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(goal, np.uint8)),
            current_pose=make(
                "geometry_msgs/msg/PoseStamped", header=header, pose=pose(self.x, self.y)
            ),
            navigation_time=duration, estimated_time_remaining=duration, number_of_recoveries=0,
            distance_remaining=left, position_tracking_error=0.0, heading_tracking_error=0.0,
        )  # fmt: skip


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--listen", default="tcp/127.0.0.1:7447")
    robot = Navigation(parser.parse_args().listen)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    print("the robot is on", flush=True)
    try:
        while True:
            time.sleep(0.05)
            robot.drive(0.05)
    except KeyboardInterrupt:
        robot.close()


if __name__ == "__main__":
    main()
