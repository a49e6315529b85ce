// A robot on Fast DDS, with what rmw_fastrtps puts on the wire: a controller of poses, servo, joint
// trajectories and a gripper. No ROS code is in it.
//
// Arguments are `key=value`. A line `ready` is printed when all is there; when standard input ends, one JSON
// object with everything that was received is printed.

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::SampleIdentity;
using eprosima::fastrtps::rtps::WriteParams;
using Bytes = std::vector<char>;
using Id = std::array<uint8_t, 16>;
using Clock = std::chrono::steady_clock;

// Any type as the bytes it has on the wire.
struct Raw : TopicDataType {
    explicit Raw(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 1 << 20;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
        auto& bytes = *static_cast<Bytes*>(data);
        std::copy(bytes.begin(), bytes.end(), payload->data);
        payload->encapsulation = CDR_LE;
        payload->length = bytes.size();
        return true;
    }
    bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return uint32_t(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

Bytes written(const std::function<void(Cdr&)>& put) {
    FastBuffer buffer;
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    put(cdr);
    return Bytes(buffer.getBuffer(), buffer.getBuffer() + cdr.getSerializedDataLength());
}

// Runs what reads a message; a message that cannot be read is told, and is then not there.
bool read(Bytes& bytes, const std::function<void(Cdr&)>& take) {
    try {
        FastBuffer buffer(bytes.data(), bytes.size());
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        cdr.read_encapsulation();
        take(cdr);
        return true;
    } catch (const std::exception& error) {
        std::cerr << "unreadable message of " << bytes.size() << " bytes: " << error.what() << std::endl;
        return false;
    }
}

std::map<std::string, std::string> told;
std::string is(const std::string& key, const std::string& otherwise = "") {
    auto found = told.find(key);
    return found == told.end() ? otherwise : found->second;
}
std::vector<std::string> words(const std::string& text) {
    std::vector<std::string> all;
    std::stringstream stream(text);
    for (std::string word; std::getline(stream, word, ',');) all.push_back(word);
    return all;
}

DomainParticipant* participant;
Publisher* publisher;
Subscriber* subscriber;
std::recursive_mutex lock;
std::atomic<bool> over{false};

Topic* topic(const std::string& name, const std::string& type) {
    if (auto* known = participant->lookup_topicdescription(name)) return static_cast<Topic*>(known);
    TypeSupport(new Raw(type)).register_type(participant);
    return participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
}

DataWriter* writer(const std::string& name, const std::string& type, bool kept = false) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = kept ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = kept ? 1 : 100;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return publisher->create_datawriter(topic(name, type), qos);
}

using Take = std::function<void(Bytes&, const SampleInfo&)>;
struct Listener : DataReaderListener {
    Take take;
    void on_data_available(DataReader* reader) override {
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            std::lock_guard<std::recursive_mutex> guard(lock);
            if (info.valid_data) take(bytes, info);
        }
    }
};

void reader(const std::string& name, const std::string& type, Take take) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().depth = 2000;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    auto* listener = new Listener;
    listener->take = std::move(take);
    subscriber->create_datareader(topic(name, type), qos, listener);
}

// A request and the way back: rmw_fastrtps tells replies apart by the identity of the request, in the inline
// QoS; the asking side may say which of its readers the reply is for.
struct Request {
    DataWriter* replies;
    SampleIdentity from;
    void reply(const std::function<void(Cdr&)>& put) const {
        Bytes bytes = written(put);
        WriteParams with;
        with.related_sample_identity(from);
        replies->write(&bytes, with);
    }
};

using Answer = std::function<void(Cdr&, const Request&)>;
void service(const std::string& name, const std::string& type, Answer answer) {
    DataWriter* replies = writer("rr" + name + "Reply", type + "_Response_");
    reader("rq" + name + "Request", type + "_Request_", [=](Bytes& bytes, const SampleInfo& info) {
        SampleIdentity from = info.sample_identity;
        auto reply_to = info.related_sample_identity.writer_guid();
        if (reply_to != eprosima::fastrtps::rtps::GUID_t::unknown()) from.writer_guid(reply_to);
        read(bytes, [&](Cdr& cdr) { answer(cdr, Request{replies, from}); });
    });
}

// What was received, as pieces of JSON.
std::vector<std::string> poses, stamps, arrivals, goals, calls;
std::string frame;
int cancels = 0;

std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.17g", value);
    // A whole number is one of reals all the same.
    bool whole = std::string(text).find_first_of(".en") == std::string::npos;
    return text + std::string(whole ? ".0" : "");
}
std::string list(const std::vector<std::string>& all) {
    std::string text = "[";
    for (size_t k = 0; k < all.size(); ++k) text += (k ? "," : "") + all[k];
    return text + "]";
}
std::string in_quotes(const std::string& text) { return "\"" + text + "\""; }
std::vector<std::string> numbers(const std::vector<double>& values) {
    std::vector<std::string> all;
    for (double value : values) all.push_back(number(value));
    return all;
}

void pose(Bytes& bytes, const SampleInfo&) {
    double now = std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
    read(bytes, [&](Cdr& cdr) {
        int32_t sec;
        uint32_t nanosec;
        std::array<double, 7> values;
        cdr >> sec >> nanosec >> frame >> values;
        poses.push_back(list(numbers({values.begin(), values.end()})));
        stamps.push_back("[" + std::to_string(sec) + "," + std::to_string(nanosec) + "]");
        arrivals.push_back(number(now));
    });
}

// An action that ends as it is told to: ok, reject, abort, stall, silent (no reply), never (no result).
struct Action {
    struct Goal {
        int8_t status = 2;
        Clock::time_point end;
        std::vector<Request> asked;
        double seconds = 0, aim = 0;
        std::vector<double> last;
    };
    std::string name, how;
    // Reads a goal, and tells it as JSON.
    std::function<std::string(Cdr&, Goal&)> parse;
    std::function<void(Cdr&, const Goal&)> result;
    std::map<Id, Goal> all;
    DataWriter *feedback, *statuses;
    std::function<void(Cdr&, const Goal&)> progress;

    void start(const std::string& package) {
        std::string base = name + "/_action/", type = package + "_";
        feedback = writer("rt" + base + "feedback", type + "FeedbackMessage_");
        statuses = writer("rt" + base + "status", "action_msgs::msg::dds_::GoalStatusArray_", true);
        service(base + "send_goal", type + "SendGoal", [this](Cdr& cdr, const Request& request) {
            if (how == "silent") return;
            Id id;
            cdr >> id;
            Goal goal;
            std::string text = parse(cdr, goal);
            bool fresh = how != "reject" && !all.count(id);
            if (fresh) {
                goal.end = Clock::now() + std::chrono::microseconds(int64_t(1e6 * goal.seconds));
                all[id] = goal;
                goals.push_back("[" + in_quotes(name) + "," + text + "," + std::to_string(poses.size()) + "]");
            }
            request.reply([&](Cdr& reply) { reply << fresh << int32_t(0) << uint32_t(0); });
            tell();
        });
        service(base + "cancel_goal", "action_msgs::srv::dds_::CancelGoal",
                [this](Cdr& cdr, const Request& request) {
            if (how == "silent") return;
            Id id;
            cdr >> id;
            auto goal = all.find(id);
            bool known = goal != all.end();
            if (known && goal->second.status == 2) {
                goal->second.status = 5;
                ++cancels;
            }
            request.reply([&](Cdr& reply) { reply << int8_t(known ? 0 : 2) << uint32_t(0); });
        });
        service(base + "get_result", type + "GetResult", [this](Cdr& cdr, const Request& request) {
            Id id;
            cdr >> id;
            if (how != "silent" && all.count(id)) all[id].asked.push_back(request);
        });
    }

    void tell() {
        Bytes bytes = written([&](Cdr& cdr) {
            cdr << uint32_t(all.size());
            for (auto& [id, goal] : all) cdr << id << int32_t(0) << uint32_t(0) << goal.status;
        });
        statuses->write(&bytes);
    }

    void go_on() {
        for (auto& [id, goal] : all) {
            if (goal.status == 2) {
                Bytes bytes = written([&, &id = id, &goal = goal](Cdr& cdr) {
                    cdr << id;
                    progress(cdr, goal);
                });
                feedback->write(&bytes);
                if (Clock::now() > goal.end && how != "never") {
                    goal.status = how == "abort" ? 6 : 4;
                    tell();
                }
            }
            if (goal.status == 2) continue;
            for (auto& request : goal.asked) request.reply([&, &goal = goal](Cdr& cdr) {
                cdr << goal.status;
                result(cdr, goal);
            });
            goal.asked.clear();
        }
    }
};

std::string gripper_goal(Cdr& cdr, Action::Goal& goal) {
    double effort;
    cdr >> goal.aim >> effort;
    goal.seconds = std::stod(is("jaw_seconds", "0.1"));
    return list(numbers({goal.aim, effort}));
}

std::string trajectory_goal(Cdr& cdr, Action::Goal& goal) {
    int32_t sec;
    uint32_t nanosec, count;
    std::string frame_id;
    std::vector<std::string> names, points;
    cdr >> sec >> nanosec >> frame_id >> names >> count;
    for (uint32_t k = 0; k < count; ++k) {
        std::vector<double> velocity, acceleration, effort;
        cdr >> goal.last >> velocity >> acceleration >> effort >> sec >> nanosec;
        goal.seconds = sec + 1e-9 * nanosec;
        auto row = numbers(goal.last);
        row.insert(row.begin(), number(goal.seconds));
        points.push_back(list(row));
    }
    for (auto& name : names) name = in_quotes(name);
    return "[" + list(names) + "," + list(points) + "]";
}

// What `ros2 param get` and `set` do, with one parameter.
struct Parameters {
    std::string name = is("parameter"), value, refusal;
    DataWriter *get = nullptr, *set = nullptr;

    DataWriter* client(const std::string& what, const std::string& type, std::function<void(Cdr&)> take) {
        std::string service = "/selvedge_play/" + what, kind = "rcl_interfaces::srv::dds_::" + type;
        reader("rr" + service + "Reply", kind + "_Response_", [take](Bytes& bytes, const SampleInfo&) {
            read(bytes, take);
        });
        return writer("rq" + service + "Request", kind + "_Request_");
    }

    // A value of type string; one of another type is left alone.
    static void put(Cdr& cdr, const std::string& text) {
        cdr << uint8_t(4) << false << int64_t(0) << 0.0 << text;
        for (int list = 0; list < 5; ++list) cdr << uint32_t(0);
    }

    void start() {
        get = client("get_parameters", "GetParameters", [this](Cdr& cdr) {
            uint32_t count;
            uint8_t type;
            bool flag;
            int64_t whole;
            double real;
            cdr >> count >> type >> flag >> whole >> real;
            if (count == 1 && type == 4) cdr >> value;
        });
        set = client("set_parameters", "SetParameters", [this](Cdr& cdr) {
            uint32_t count;
            bool done;
            cdr >> count >> done >> refusal;
            if (count != 1 || done) refusal = "it was set";
        });
    }

    // Until there is an answer: what is sent before the other side has matched is lost.
    void ask() {
        if (get && value.empty()) {
            Bytes bytes = written([&](Cdr& cdr) { cdr << uint32_t(1) << name; });
            get->write(&bytes);
        }
        if (set && refusal.empty()) {
            Bytes bytes = written([&](Cdr& cdr) {
                cdr << uint32_t(1) << name;
                put(cdr, "another");
            });
            set->write(&bytes);
        }
    }
};

void call(const std::string& name, int value) {
    calls.push_back("[" + in_quotes(name) + "," + std::to_string(value) + "," + std::to_string(poses.size()) + "]");
}

int main(int count, char** arguments) {
    for (int k = 1; k < count; ++k) {
        std::string word = arguments[k];
        auto at = word.find('=');
        told[word.substr(0, at)] = word.substr(at + 1);
    }
    // 127.0.0.1 only, and without multicast, which `lo` often has not.
    int domain = std::stoi(is("domain"));
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    transport->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(transport);
    for (int other = 0; other < 10; ++other) {
        eprosima::fastrtps::rtps::Locator_t locator;
        eprosima::fastrtps::rtps::IPLocator::setIPv4(locator, "127.0.0.1");
        locator.port = 7400 + 250 * domain + 10 + 2 * other;
        qos.wire_protocol().builtin.initialPeersList.push_back(locator);
    }
    for (auto& [key, value] : told)
        if (key.rfind("dds.", 0) == 0) qos.properties().properties().emplace_back(key, value);
    participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    if (!participant) {
        std::cerr << "no participant" << std::endl;
        return 1;
    }
    publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);

    Action gripper;
    gripper.name = "/gripper";
    gripper.how = is("gripper", "ok");
    gripper.parse = gripper_goal;
    gripper.progress = [](Cdr& cdr, const Action::Goal& goal) { cdr << goal.aim << 0.0 << false << false; };
    gripper.result = [&](Cdr& cdr, const Action::Goal& goal) {
        bool stalled = gripper.how == "stall";
        cdr << goal.aim << 20.0 << stalled << !stalled;
    };
    if (gripper.how != "none") gripper.start("control_msgs::action::dds_::GripperCommand");

    std::string kind = is("arm_kind", "cartesian");
    Action arm;
    arm.name = "/arm/follow_joint_trajectory";
    arm.how = is("arm", "ok");
    arm.parse = trajectory_goal;
    arm.progress = [](Cdr& cdr, const Action::Goal&) {
        cdr << int32_t(0) << uint32_t(0) << std::string() << uint32_t(0);
    };
    arm.result = [&](Cdr& cdr, const Action::Goal&) {
        bool failed = arm.how == "abort";
        cdr << int32_t(failed ? -4 : 0) << std::string(failed ? "path tolerance" : "");
    };
    if (kind == "joints") arm.start("control_msgs::action::dds_::FollowJointTrajectory");

    DataWriter* status = nullptr;
    if (kind == "servo") {
        service("/servo_node/switch_command_type", "moveit_msgs::srv::dds_::ServoCommandType",
                [](Cdr& cdr, const Request& request) {
            int8_t type;
            cdr >> type;
            call("type", type);
            if (is("servo") != "silent") request.reply([](Cdr& reply) { reply << (is("servo") != "refuse"); });
        });
        service("/servo_node/pause_servo", "std_srvs::srv::dds_::SetBool",
                [](Cdr& cdr, const Request& request) {
            bool pause;
            cdr >> pause;
            call("pause", pause);
            request.reply([](Cdr& reply) { reply << true << std::string(); });
        });
        status = writer("rt/servo_node/status", "moveit_msgs::msg::dds_::ServoStatus_");
    }
    std::string target = kind == "servo" ? "/servo_node/pose_target_cmds" : "/target_pose";
    reader("rt" + target, "geometry_msgs::msg::dds_::PoseStamped_", pose);
    DataWriter* joints = writer("rt/joint_states", "sensor_msgs::msg::dds_::JointState_");

    Parameters parameters;
    if (!parameters.name.empty()) parameters.start();

    std::vector<std::string> names = words(is("names"));
    std::vector<double> positions;
    for (auto& word : words(is("joints"))) positions.push_back(std::stod(word));

    std::thread work([&] {
        for (int tick = 0; !over; ++tick) {
            {
                std::lock_guard<std::recursive_mutex> guard(lock);
                if (gripper.how != "none") gripper.go_on();
                if (kind == "joints") arm.go_on();
                if (tick % 20 == 0) parameters.ask();
                for (auto& [id, goal] : arm.all)
                    if (goal.status == 4) positions = goal.last;
                Bytes bytes = written([&](Cdr& cdr) {
                    auto now = std::chrono::system_clock::now().time_since_epoch();
                    double t = std::chrono::duration<double>(now).count();
                    cdr << int32_t(t) << uint32_t(1e9 * (t - std::floor(t))) << std::string();
                    cdr << names << positions << uint32_t(0) << uint32_t(0);
                });
                joints->write(&bytes);
                if (status) {
                    Bytes ok = written([](Cdr& cdr) { cdr << int8_t(0) << std::string(); });
                    status->write(&ok);
                }
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
    });
    std::cout << "ready" << std::endl;
    for (std::string line; std::getline(std::cin, line);) {}
    over = true;
    work.join();
    std::lock_guard<std::recursive_mutex> guard(lock);
    std::cout << "{\"poses\":" << list(poses) << ",\"stamps\":" << list(stamps) << ",\"arrivals\":"
              << list(arrivals) << ",\"goals\":" << list(goals) << ",\"calls\":" << list(calls)
              << ",\"parameter\":" << in_quotes(parameters.value) << ",\"refusal\":"
              << in_quotes(parameters.refusal) << ",\"cancels\":" << cancels << ",\"frames\":[" << (frame.empty() ? "" : in_quotes(frame))
              << "]}" << std::endl;
    std::_Exit(0);
}
