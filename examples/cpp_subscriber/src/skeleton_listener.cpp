// Prints where everybody's right hand is: ros2 run depth_pose_cpp_subscriber skeleton_listener
#include <cstdio>
#include <memory>

#include "depth_pose_msgs/msg/skeleton_array.hpp"
#include "hands.hpp"
#include "rclcpp/rclcpp.hpp"

class SkeletonListener : public rclcpp::Node
{
public:
  SkeletonListener()
  : Node("skeleton_listener")
  {
    subscription_ = create_subscription<depth_pose_msgs::msg::SkeletonArray>(
      "/depth_pose/skeletons", rclcpp::SensorDataQoS(),
      [](const depth_pose_msgs::msg::SkeletonArray & frame) {listen(frame);});
  }

private:
  static void listen(const depth_pose_msgs::msg::SkeletonArray & frame)
  {
    if (frame.skeletons.empty()) {
      std::printf("nobody\n");
    }
    for (const auto & skeleton : frame.skeletons) {
      const auto hand = find_joint(skeleton, "right_wrist", 0.5f);
      if (hand) {  // metres; x right, y down, z away from the camera
        std::printf(
          "%s: right hand at %.2f %.2f %.2f\n", skeleton.body_id.c_str(), hand->position.x,
          hand->position.y, hand->position.z);
      } else {
        std::printf("%s: right hand not seen\n", skeleton.body_id.c_str());
      }
    }
    std::fflush(stdout);
  }

  rclcpp::Subscription<depth_pose_msgs::msg::SkeletonArray>::SharedPtr subscription_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<SkeletonListener>());
  rclcpp::shutdown();
  return 0;
}
