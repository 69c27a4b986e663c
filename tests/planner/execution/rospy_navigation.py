"""For the system's Python: an actionlib server at /move_base, which has another one drive."""

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction


def execute(goal):
    rospy.loginfo("goal")
    drive.send_goal(goal)
    while not drive.wait_for_result(rospy.Duration(0.05)):
        if server.is_preempt_requested():
            drive.cancel_goal()
            server.set_preempted(text="preempted")
            return
    text = drive.get_goal_status_text()
    if drive.get_state() == GoalStatus.SUCCEEDED:
        server.set_succeeded(text=text)
    else:
        server.set_aborted(text=text)


rospy.init_node("navigation")
drive = actionlib.SimpleActionClient("/house/move_base", MoveBaseAction)
server = actionlib.SimpleActionServer("/move_base", MoveBaseAction, execute, auto_start=False)
drive.wait_for_server()
server.start()
rospy.spin()
