// The rover of ../src for rclcpp: the same topics, parameters, service and action, without the
// guarantee and the budget, which rclcpp does not have. Not built in CI: see README.md.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <geometry_msgs/msg/twist.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_action/rclcpp_action.hpp>
#include <rclcpp_lifecycle/lifecycle_node.hpp>
#include <rover_msgs/action/drive.hpp>
#include <rover_msgs/msg/health.hpp>
#include <rover_msgs/srv/self_test.hpp>
#include <sensor_msgs/msg/image.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <std_msgs/msg/u_int64.hpp>

using namespace std::chrono_literals;
using geometry_msgs::msg::Twist;
using rover_msgs::action::Drive;
using rover_msgs::msg::Health;
using rover_msgs::srv::SelfTest;
using sensor_msgs::msg::Image;
using sensor_msgs::msg::Imu;
using std_msgs::msg::UInt64;

class Sensors : public rclcpp::Node
{
public:
  Sensors() : Node("sensors")
  {
    gyroscope_ = create_publisher<Imu>("imu", rclcpp::SensorDataQoS());
    camera_ = create_publisher<Image>("image", rclcpp::SensorDataQoS());
    imu_.angular_velocity.z = 0.2;
    image_.height = 48;
    image_.width = 64;
    image_.step = 64;
    image_.encoding = "mono8";
    for (int i = 0; i < 64 * 48; ++i) {
      image_.data.push_back(static_cast<uint8_t>(i));
    }
    fast_ = create_wall_timer(10ms, [this]() {
      imu_.header.stamp = now();
      gyroscope_->publish(imu_);
    });
    slow_ = create_wall_timer(100ms, [this]() {
      image_.header.stamp = now();
      camera_->publish(image_);
    });
  }

private:
  Imu imu_;
  Image image_;
  rclcpp::Publisher<Imu>::SharedPtr gyroscope_;
  rclcpp::Publisher<Image>::SharedPtr camera_;
  rclcpp::TimerBase::SharedPtr fast_, slow_;
};

class Control : public rclcpp_lifecycle::LifecycleNode
{
public:
  Control() : LifecycleNode("control")
  {
    rcl_interfaces::msg::FloatingPointRange range;
    range.from_value = 0.0;
    range.to_value = 2.0;
    rcl_interfaces::msg::ParameterDescriptor gain;
    gain.description = "of the yaw rate";
    gain.floating_point_range.push_back(range);
    declare_parameter("gain", 0.5, gain);
    rcl_interfaces::msg::ParameterDescriptor autostart;
    autostart.read_only = true;
    declare_parameter("autostart", true, autostart);

    command_ = create_publisher<Twist>("cmd_vel", rclcpp::QoS(10));
    imu_ = create_subscription<Imu>(
      "imu", rclcpp::SensorDataQoS(), [this](const Imu & imu) {
        Twist twist;
        twist.angular.z = -get_parameter("gain").as_double() * imu.angular_velocity.z;
        command_->publish(twist);  // nothing leaves while the node is not active
      });
    if (get_parameter("autostart").as_bool()) {
      configure();
      activate();
    }
  }

private:
  rclcpp_lifecycle::LifecyclePublisher<Twist>::SharedPtr command_;
  rclcpp::Subscription<Imu>::SharedPtr imu_;
};

class Camera : public rclcpp::Node
{
public:
  Camera() : Node("camera")
  {
    frames_ = create_publisher<UInt64>("frames", rclcpp::QoS(10));
    image_ = create_subscription<Image>(
      "image", rclcpp::SensorDataQoS(), [this](const Image & image) {
        volatile uint64_t edges_found = 0;
        for (int i = 0; i < 500; ++i) {
          edges_found = edges_found + edges(image.data);
        }
        UInt64 seen;
        seen.data = ++seen_;
        frames_->publish(seen);
      });
  }

private:
  // Number of neighbours that differ by more than 16 grey levels.
  static uint64_t edges(const std::vector<uint8_t> & pixels)
  {
    uint64_t found = 0;
    for (size_t i = 1; i < pixels.size(); ++i) {
      found += std::abs(pixels[i] - pixels[i - 1]) > 16;
    }
    return found;
  }

  uint64_t seen_ = 0;
  rclcpp::Publisher<UInt64>::SharedPtr frames_;
  rclcpp::Subscription<Image>::SharedPtr image_;
};

class Diagnostics : public rclcpp::Node
{
  using Goal = rclcpp_action::ServerGoalHandle<Drive>;

public:
  Diagnostics() : Node("diagnostics")
  {
    health_ = create_publisher<Health>("health", rclcpp::QoS(1).transient_local());
    frames_ = create_subscription<UInt64>(
      "frames", rclcpp::QoS(10), [this](const UInt64 & n) { seen_ = n.data; });
    command_ = create_subscription<Twist>(
      "cmd_vel", rclcpp::QoS(10), [this](const Twist & twist) { yaw_rate_ = twist.angular.z; });
    second_ = create_wall_timer(1s, [this]() {
      Health health;
      health.header.stamp = now();
      health.header.frame_id = "base_link";
      health.frames = seen_;
      health.yaw_rate = yaw_rate_;
      health_->publish(health);
    });
    self_test_ = create_service<SelfTest>(
      "self_test", [this](
        const std::shared_ptr<SelfTest::Request>, std::shared_ptr<SelfTest::Response> answer) {
        answer->ok = seen_ > 0;
        answer->report = std::to_string(seen_) + " pictures";
      });
    server_ = rclcpp_action::create_server<Drive>(
      this, "drive",
      [this](const rclcpp_action::GoalUUID &, std::shared_ptr<const Drive::Goal> goal) {
        const bool fits = goal->distance >= 0.0 && goal->distance <= 100.0 && !goal_;
        return fits ? rclcpp_action::GoalResponse::ACCEPT_AND_EXECUTE :
               rclcpp_action::GoalResponse::REJECT;
      },
      [](const std::shared_ptr<Goal>) { return rclcpp_action::CancelResponse::ACCEPT; },
      [this](const std::shared_ptr<Goal> goal) {
        driven_ = 0.0;
        goal_ = goal;
      });
    step_ = create_wall_timer(50ms, [this]() { drive(); });
  }

private:
  // Ten centimetres more.
  void drive()
  {
    if (!goal_) {
      return;
    }
    const double distance = goal_->get_goal()->distance;
    const bool arrived = driven_ >= distance;
    if (!arrived && !goal_->is_canceling()) {
      driven_ = std::min(distance, driven_ + 0.1);
      auto feedback = std::make_shared<Drive::Feedback>();
      feedback->so_far = driven_;
      goal_->publish_feedback(feedback);
      return;
    }
    auto result = std::make_shared<Drive::Result>();
    result->driven = driven_;
    if (arrived) {
      goal_->succeed(result);
    } else {
      goal_->canceled(result);
    }
    goal_.reset();
  }

  std::atomic<uint64_t> seen_{0};
  std::atomic<double> yaw_rate_{0.0};
  double driven_ = 0.0;
  std::shared_ptr<Goal> goal_;
  rclcpp::Publisher<Health>::SharedPtr health_;
  rclcpp::Subscription<UInt64>::SharedPtr frames_;
  rclcpp::Subscription<Twist>::SharedPtr command_;
  rclcpp::TimerBase::SharedPtr second_, step_;
  rclcpp::Service<SelfTest>::SharedPtr self_test_;
  rclcpp_action::Server<Drive>::SharedPtr server_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::executors::MultiThreadedExecutor executor;
  auto sensors = std::make_shared<Sensors>();
  auto control = std::make_shared<Control>();
  auto camera = std::make_shared<Camera>();
  auto diagnostics = std::make_shared<Diagnostics>();
  executor.add_node(sensors);
  executor.add_node(control->get_node_base_interface());
  executor.add_node(camera);
  executor.add_node(diagnostics);
  executor.spin();
  rclcpp::shutdown();
  return 0;
}
