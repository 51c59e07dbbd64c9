"""The action modes of peer.py."""

import time

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from test_msgs.action import Fibonacci


def fibonacci(order):
    numbers = [0, 1]
    while len(numbers) < order:
        numbers.append((numbers[-1] + numbers[-2] + 2**31) % 2**32 - 2**31)
    return numbers


class Goal:
    """A goal of ours and what was heard of it."""

    def __init__(self, node, client, order, until):
        self.feedback = []
        sent = client.send_goal_async(
            Fibonacci.Goal(order=order),
            feedback_callback=lambda m: self.feedback.append(list(m.feedback.sequence)),
        )
        until(node, sent.done)
        self.handle = sent.result()


def action_client(node, count, say, until):
    client = ActionClient(node, Fibonacci, "fib")
    until(node, client.server_is_ready)
    # Feedback is volatile: both sides know each other once some of it has come.
    known = False
    while not known:
        goal = Goal(node, client, 3, until)
        ended = goal.handle.get_result_async()
        until(node, ended.done)
        for _ in range(10):
            rclpy.spin_once(node, timeout_sec=0.05)
        known = bool(goal.feedback)
    right = 0
    for number in range(count):
        order = 3 + number % 8
        goal = Goal(node, client, order, until)
        ended = goal.handle.get_result_async()
        until(node, ended.done)
        expected = [fibonacci(n) for n in range(3, order + 1)]
        until(node, lambda: len(goal.feedback) >= len(expected))
        # By the status topic.
        until(node, lambda: goal.handle.status == GoalStatus.STATUS_SUCCEEDED)
        right += (
            goal.handle.accepted
            and goal.feedback == expected
            and ended.result().status == GoalStatus.STATUS_SUCCEEDED
            and list(ended.result().result.sequence) == fibonacci(order)
        )
    say("succeeded", right, "of", count)
    goal = Goal(node, client, 100000, until)
    until(node, lambda: goal.feedback)
    canceled = goal.handle.cancel_goal_async()
    until(node, canceled.done)
    ended = goal.handle.get_result_async()
    until(node, ended.done)
    say("canceled", ended.result().status, len(canceled.result().goals_canceling) == 1)
    say("rejected", not Goal(node, client, 0, until).handle.accepted)


def action_server(node, say):
    def execute(goal):
        feedback = Fibonacci.Feedback()
        order = goal.request.order
        numbers = fibonacci(2)
        while len(numbers) < order:
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=numbers)
            numbers = fibonacci(len(numbers) + 1)
            feedback.sequence = numbers
            goal.publish_feedback(feedback)
            time.sleep(0.005)
        goal.succeed()
        return Fibonacci.Result(sequence=numbers)

    server = ActionServer(
        node,
        Fibonacci,
        "fib",
        execute,
        goal_callback=lambda r: GoalResponse.ACCEPT if r.order > 1 else GoalResponse.REJECT,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    say("ready")
    executor.spin()
    server.destroy()
