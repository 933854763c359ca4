// A camera driver in C++ that knows nothing of depth_pose, on rcl, on which rclcpp stands as well.
// driver reliable|best_effort COUNT: 640 x 480 at 30 a second, with the settings of Fast DDS that it finds.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/image.hpp>

using Clock = std::chrono::system_clock;
using sensor_msgs::msg::CameraInfo;
using sensor_msgs::msg::Image;

static void check(rcl_ret_t code) {
  if (code == RCL_RET_OK) return;
  std::fprintf(stderr, "%s\n", rcl_get_error_string().str);
  std::exit(1);
}

template <typename Message>
static rcl_publisher_t advertise(rcl_node_t& node, const char* topic, bool reliable) {
  rcl_publisher_t made = rcl_get_zero_initialized_publisher();
  rcl_publisher_options_t options = rcl_publisher_get_default_options();
  options.qos.depth = 5;
  options.qos.reliability =
    reliable ? RMW_QOS_POLICY_RELIABILITY_RELIABLE : RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT;
  const auto* type = rosidl_typesupport_cpp::get_message_type_support_handle<Message>();
  check(rcl_publisher_init(&made, &node, type, topic, &options));
  return made;
}

static bool is_heard(const rcl_publisher_t& publisher) {
  size_t count = 0;
  check(rcl_publisher_get_subscription_count(&publisher, &count));
  return count > 0;
}

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const bool reliable = std::string(argv[1]) == "reliable";
  const int count = std::atoi(argv[2]);
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  check(rcl_init_options_init(&options, rcl_get_default_allocator()));
  rcl_context_t context = rcl_get_zero_initialized_context();
  check(rcl_init(0, nullptr, &options, &context));
  rcl_node_t node = rcl_get_zero_initialized_node();
  rcl_node_options_t node_options = rcl_node_get_default_options();
  check(rcl_node_init(&node, "driver", "", &context, &node_options));
  rcl_publisher_t images = advertise<Image>(node, "/camera/depth/image_raw", reliable);
  rcl_publisher_t infos = advertise<CameraInfo>(node, "/camera/depth/camera_info", reliable);

  CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.k = {525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0};
  Image image;
  image.width = 640;
  image.height = 480;
  image.step = 1280;
  image.encoding = "16UC1";
  for (int i = 0; i < 640 * 480; ++i) {
    image.data.push_back(2500 & 255);
    image.data.push_back(2500 >> 8);
  }
  image.header.frame_id = info.header.frame_id = "camera";
  while (!is_heard(images) || !is_heard(infos)) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  std::this_thread::sleep_for(std::chrono::seconds(2));
  const auto began = std::chrono::steady_clock::now();
  for (int i = 0; i < count; ++i) {
    const auto now = std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
    image.header.stamp.sec = static_cast<int32_t>(now / 1000000000);
    image.header.stamp.nanosec = static_cast<uint32_t>(now % 1000000000);
    info.header.stamp = image.header.stamp;
    check(rcl_publish(&infos, &info, nullptr));
    check(rcl_publish(&images, &image, nullptr));
    std::this_thread::sleep_until(began + std::chrono::nanoseconds((i + 1) * 1000000000LL / 30));
  }
  std::this_thread::sleep_for(std::chrono::seconds(2));
  std::printf("sent %d\n", count);
  return 0;
}
