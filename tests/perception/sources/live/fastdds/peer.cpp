// A peer of Fast DDS that passes serialised messages on, without their types, as ROS 2's nodes send
// them: with the type's name and no description of it.
//
// peer DOMAIN, then on stdin "pub|sub TOPIC TYPE reliable|best latched|volatile" lines, and messages:
// "msg TOPIC SIZE", a new line, and SIZE bytes of CDR with its header. On stdout it writes what
// subscribed topics get, in the same form, and "matched TOPIC" for each subscriber of ours.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <iostream>
#include <map>
#include <mutex>
#include <string>
#include <vector>

using namespace eprosima::fastdds::dds;
using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<unsigned char>;

class Plain : public TopicDataType {
 public:
  explicit Plain(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 1024;  // at first; it grows
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, Payload* payload) override {
    auto& bytes = *static_cast<Bytes*>(data);
    payload->encapsulation = CDR_LE;
    payload->length = bytes.size();
    memcpy(payload->data, bytes.data(), bytes.size());
    return true;
  }
  bool deserialize(Payload* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

std::mutex output;

class Heard : public DataReaderListener {
  void on_data_available(DataReader* reader) override {
    Bytes bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) {
        std::lock_guard<std::mutex> one(output);
        std::cout << "msg " << reader->get_topicdescription()->get_name().substr(2) << " "
                  << bytes.size() << "\n";
        std::cout.write(reinterpret_cast<char*>(bytes.data()), bytes.size()).flush();
      }
  }
};

class Matched : public DataWriterListener {
  void on_publication_matched(DataWriter* writer, const PublicationMatchedStatus& now) override {
    std::lock_guard<std::mutex> one(output);
    if (now.current_count_change > 0)
      std::cout << "matched " << writer->get_topic()->get_name().substr(2) << std::endl;
  }
};

int main(int, char** words) {
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      atoi(words[1]), PARTICIPANT_QOS_DEFAULT);
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  std::map<std::string, DataWriter*> writers;
  Heard heard;
  Matched matched;
  std::string what, name;
  while (std::cin >> what >> name) {
    if (what == "msg") {
      size_t size;
      std::cin >> size;
      std::cin.get();
      Bytes bytes(size);
      std::cin.read(reinterpret_cast<char*>(bytes.data()), size);
      writers.at(name)->write(&bytes);
      continue;
    }
    std::string kind, reliable, latched;
    std::cin >> kind >> reliable >> latched;
    TypeSupport type(new Plain(kind));
    type.register_type(participant);
    auto* topic = participant->create_topic("rt" + name, kind, TOPIC_QOS_DEFAULT);
    auto reliability = reliable == "reliable" ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    auto durability = latched == "latched" ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    auto memory = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;  // as ROS 2 has it
    if (what == "pub") {
      DataWriterQos quality = DATAWRITER_QOS_DEFAULT;
      quality.reliability().kind = reliability;
      quality.durability().kind = durability;
      quality.history().depth = latched == "latched" ? 1 : 5;
      quality.endpoint().history_memory_policy = memory;
      quality.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
      writers[name] = publisher->create_datawriter(topic, quality, &matched);
    } else {
      DataReaderQos quality = DATAREADER_QOS_DEFAULT;
      quality.reliability().kind = reliability;
      quality.durability().kind = durability;
      quality.history().depth = 5;
      quality.endpoint().history_memory_policy = memory;
      subscriber->create_datareader(topic, quality, &heard);
    }
  }
  _Exit(0);
}
