// A client in C++ that uses everything the driver offers every two seconds, as the example in the thesis does (B.4).
#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <tf/tf.h>
#include <txt_driver/Battery.h>
#include <txt_driver/PidLoad.h>
#include <txt_driver/Pwm.h>
#include <txt_driver/PwmTest.h>
#include <txt_driver/Shutdown.h>
#include <txt_driver/SwitchedPwr.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "client");
  ros::NodeHandle node;
  nav_msgs::Odometry last;
  auto velocities = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  auto servos = node.advertise<txt_driver::Pwm>("/pwm", 1);
  auto combined = node.advertise<nav_msgs::Odometry>("/odom_comb", 1);
  boost::function<void(const nav_msgs::OdometryConstPtr&)> moved = [&](const nav_msgs::OdometryConstPtr& m) {
    last = *m;
    ROS_INFO("odom %f %f %f %f", m->pose.pose.position.x, m->pose.pose.position.y,
             tf::getYaw(m->pose.pose.orientation), m->twist.twist.linear.x);
  };
  boost::function<void(const txt_driver::BatteryConstPtr&)> measured = [](const txt_driver::BatteryConstPtr& m) {
    ROS_INFO("battery %f %f %f", m->batt1, m->batt2, m->expected_time.toSec());
  };
  auto odometry = node.subscribe<nav_msgs::Odometry>("/odom", 1, moved);
  auto batteries = node.subscribe<txt_driver::Battery>("/battery", 1, measured);
  auto load = node.serviceClient<txt_driver::PidLoad>("/pid_load");
  auto shutdown = node.serviceClient<txt_driver::Shutdown>("/shutdown_computer");
  auto test = node.serviceClient<txt_driver::PwmTest>("/pwm_change");
  auto power = node.serviceClient<txt_driver::SwitchedPwr>("/switched_pwr");
  ros::Timer timer = node.createTimer(ros::Duration(2.0), [&](const ros::TimerEvent&) {
    geometry_msgs::Twist velocity;
    velocity.linear.x = 0.5;
    velocity.angular.z = 0.3;
    velocities.publish(velocity);
    txt_driver::Pwm pwm;
    pwm.pwm4 = 12000;
    pwm.pwm5 = -24000;
    servos.publish(pwm);
    combined.publish(last);
    txt_driver::PidLoad gains;
    if (load.call(gains)) ROS_INFO("PID Load Response: %d", gains.response.result);
    txt_driver::Shutdown off;
    off.request.request = true;
    if (shutdown.call(off)) ROS_INFO("Shutdown called: %d", off.response.result);
    txt_driver::PwmTest by_hand;
    by_hand.request.esc = 24000;
    by_hand.request.front = 12000;
    by_hand.request.pwm4 = -12000;
    by_hand.request.pwm5 = -24000;
    if (test.call(by_hand)) ROS_INFO("PWM Response: %d", by_hand.response.result);
    txt_driver::SwitchedPwr atx;
    atx.request.source = atx.request.SOURCE_ATX;
    atx.request.on = true;
    if (power.call(atx)) ROS_INFO("PWR Response: %d", atx.response.result);
  });
  ros::spin();
}
