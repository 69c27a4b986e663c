// A behaviour-tree node for Nav2 that asks a map where to look next for a thing.
//
//   <WhereToLook map="/home/robot/kitchen.map" object="cup" goal="{look}" percent="{percent}"/>
//
// runs `hereabouts find MAP OBJECT --json` beside the tree, and sets `goal` to the first look of its
// plan that this node has not given yet; `percent` is the chance that the look shows the thing.
// It fails where the plan has no other look. `hereabouts live ... --publish` maps meanwhile, tells
// where the robot is, and publishes the goals' frame in tf.
//
// In a package of yours with behaviortree_cpp and geometry_msgs:
//   add_library(where_to_look SHARED where_to_look.cpp)
//   ament_target_dependencies(where_to_look behaviortree_cpp geometry_msgs)
//   target_compile_definitions(where_to_look PRIVATE BT_PLUGIN_EXPORT)
// and in the parameters of bt_navigator: plugin_lib_names: [where_to_look]. The tree beside this
// file, look_for_cup.xml, uses it. ROS 2 Humble has behaviortree_cpp_v3, and no JSON with it.
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/contrib/json.hpp"
#include "geometry_msgs/msg/pose_stamped.hpp"

extern char** environ;

class WhereToLook : public BT::StatefulActionNode {
 public:
  using Goal = geometry_msgs::msg::PoseStamped;
  using BT::StatefulActionNode::StatefulActionNode;

  static BT::PortsList providedPorts() {
    return {BT::InputPort<std::string>("map", "folder of the map, or address of its server"),
            BT::InputPort<std::string>("object", "what to find, e.g. cup"),
            BT::InputPort<std::string>("program", "hereabouts", "path of the command"),
            BT::InputPort<std::string>("frame", "hereabouts", "frame of the map in tf"),
            BT::OutputPort<Goal>("goal", "where to stand, and which way to look"),
            BT::OutputPort<int>("percent", "chance that the look shows the thing")};
  }

  BT::NodeStatus onStart() override {
    const auto map = getInput<std::string>("map"), object = getInput<std::string>("object");
    if (!map || !object) throw BT::RuntimeError("WhereToLook needs map and object");
    if (object.value() != object_) given_.clear();
    object_ = object.value();
    answer_.clear();
    return start({getInput<std::string>("program").value(), "find", map.value(), "--json", "--", object_})
               ? BT::NodeStatus::RUNNING
               : BT::NodeStatus::FAILURE;
  }

  BT::NodeStatus onRunning() override {
    char part[4096];
    ssize_t size;
    while ((size = read(output_, part, sizeof part)) > 0) answer_.append(part, size);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return BT::NodeStatus::RUNNING;
    int status = 0;
    close(output_);
    waitpid(child_, &status, 0);
    child_ = 0;
    try {
      return status == 0 && choose() ? BT::NodeStatus::SUCCESS : BT::NodeStatus::FAILURE;
    } catch (const nlohmann::json::exception&) {  // no plan, and no reason for Nav2 to end
      return BT::NodeStatus::FAILURE;
    }
  }

  void onHalted() override {
    if (child_ == 0) return;
    kill(child_, SIGTERM);
    close(output_);
    waitpid(child_, nullptr, 0);
    child_ = 0;
  }

  ~WhereToLook() override { onHalted(); }

 private:
  struct Look {
    double x, y, heading;
  };

  // Starts the command, whose output `output_` reads without waiting.
  bool start(std::vector<std::string> words) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0) return false;
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
    std::vector<char*> arguments;
    for (auto& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    const int failed =
        posix_spawnp(&child_, arguments[0], &files, nullptr, arguments.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    close(ends[1]);
    output_ = ends[0];
    if (failed) {
      child_ = 0;
      close(output_);
    }
    return !failed;
  }

  // Takes the first look of the plan that was not given yet.
  bool choose() {
    const auto plan = nlohmann::json::parse(answer_);
    for (const auto& step : plan.at("steps")) {
      const Look look{step.at("x"), step.at("y"), step.at("heading")};
      bool known = false;
      for (const auto& one : given_)
        known = known || (std::hypot(one.x - look.x, one.y - look.y) < 0.3 &&
                          std::abs(std::remainder(one.heading - look.heading, 2 * M_PI)) < 0.5);
      if (known) continue;
      given_.push_back(look);
      Goal goal;  // without a stamp: by the latest transform
      goal.header.frame_id = getInput<std::string>("frame").value();
      goal.pose.position.x = look.x;
      goal.pose.position.y = look.y;
      goal.pose.orientation.z = std::sin(look.heading / 2);
      goal.pose.orientation.w = std::cos(look.heading / 2);
      setOutput("goal", goal);
      setOutput("percent", static_cast<int>(std::lround(100 * step.at("probability").get<double>())));
      return true;
    }
    return false;
  }

  std::string object_, answer_;
  std::vector<Look> given_;
  pid_t child_ = 0;
  int output_ = -1;
};

BT_REGISTER_NODES(factory) { factory.registerNodeType<WhereToLook>("WhereToLook"); }
