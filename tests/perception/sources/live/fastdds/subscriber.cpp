// Prints the first message of /hereabouts/objects in a domain, as Fast DDS reads it: a subscriber
// that is reliable and transient local.
#include <chrono>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <iostream>
#include <thread>

#include "ObjectsPubSubTypes.h"

using namespace eprosima::fastdds::dds;

int main(int, char** words) {
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      atoi(words[1]), PARTICIPANT_QOS_DEFAULT);
  TypeSupport type(new vision_msgs::msg::dds_::Detection3DArray_PubSubType());
  type.register_type(participant);
  auto* topic =
      participant->create_topic("rt/hereabouts/objects", type.get_type_name(), TOPIC_QOS_DEFAULT);
  DataReaderQos quality = DATAREADER_QOS_DEFAULT;
  quality.reliability().kind = RELIABLE_RELIABILITY_QOS;
  quality.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
  auto* reader =
      participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, quality);
  vision_msgs::msg::dds_::Detection3DArray_ message;
  SampleInfo info;
  for (int tick = 0; tick < 600; ++tick) {
    if (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK && info.valid_data) {
      std::cout << message.header().frame_id();
      for (auto& one : message.detections())
        std::cout << "|" << one.id() << "," << one.results()[0].hypothesis().class_id() << ","
                  << one.bbox().center().position().x() << "," << one.bbox().size().z();
      std::cout << std::endl;
      return 0;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return 1;
}
