// What a skeleton says of a hand; needs the messages' headers alone.
#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "depth_pose_msgs/msg/joint.hpp"
#include "depth_pose_msgs/msg/skeleton.hpp"

// The joint of a name, if it is to be relied on.
inline std::optional<depth_pose_msgs::msg::Joint> find_joint(
  const depth_pose_msgs::msg::Skeleton & skeleton, const std::string & name, float least_confidence)
{
  const auto & joints = skeleton.joints;
  const auto found = std::find_if(
    joints.begin(), joints.end(), [&name](const auto & joint) {return joint.name == name;});
  if (found == joints.end() || found->confidence < least_confidence ||
    found->state == depth_pose_msgs::msg::Joint::OUTSIDE_IMAGE)
  {
    return std::nullopt;
  }
  return *found;
}
