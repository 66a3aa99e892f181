// The parts of ArduPilot that a backend of AC_CustomControl uses, as far as its published headers declare them; own code.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdio>

#define AP_CUSTOMCONTROL_ENABLED 1

struct Vector3f {
    float x, y, z;
};

inline float wrap_PI(float angle)
{
    const float turn = 6.2831853f;
    return angle - turn * std::floor(angle / turn + 0.5f);
}

/* Of rotations about one axis alone, which is enough here: as angles. */
struct Quaternion {
    Vector3f angles;
    void to_euler(float &roll, float &pitch, float &yaw) const { roll = angles.x; pitch = angles.y; yaw = angles.z; }
    Quaternion inverse(void) const { return {{-angles.x, -angles.y, -angles.z}}; }
    Quaternion operator*(const Quaternion &o) const { return {{angles.x + o.angles.x, angles.y + o.angles.y, angles.z + o.angles.z}}; }
    Vector3f operator*(const Vector3f &v) const { return v; }
};

struct AP_AHRS_View {
    Quaternion attitude;
    Vector3f gyro;
    void get_quat_body_to_ned(Quaternion &q) const { q = attitude; }
    const Vector3f &get_gyro_latest(void) const { return gyro; }
};

struct AC_AttitudeControl {
    Quaternion target;
    Vector3f rates;
    Quaternion get_attitude_target_quat() const { return target; }
    Vector3f get_attitude_target_ang_vel() const { return rates; }
};

struct AP_Motors {
    enum class SpoolState : uint8_t { SHUT_DOWN, GROUND_IDLE, SPOOLING_UP, THROTTLE_UNLIMITED, SPOOLING_DOWN };
};

struct AP_MotorsMulticopter : AP_Motors {
    SpoolState state;
    float roll, pitch, yaw;
    SpoolState get_spool_state(void) const { return state; }
    float get_roll() const { return roll; }
    float get_pitch() const { return pitch; }
    float get_yaw() const { return yaw; }
};

template <class T> struct AP_Number {
    T value;
    T get() const { return value; }
};
typedef AP_Number<float> AP_Float;
typedef AP_Number<int8_t> AP_Int8;
typedef AP_Number<int16_t> AP_Int16;

struct AP_Param {
    struct GroupInfo {
        const char *name;
        uint8_t index;
        float initial;
        void (*set)(void *, float);
    };
    static void setup_object_defaults(void *object, const GroupInfo *info)
    {
        for (; info->name != nullptr; ++info) {
            info->set(object, info->initial);
        }
    }
};
#define AP_GROUPINFO(name, index, kind, member, initial) \
    { name, index, initial, [](void *o, float v) { auto &m = static_cast<kind *>(o)->member; m.value = decltype(m.value)(v); } }
#define AP_GROUPEND { nullptr, 0, 0.0f, nullptr }

class AC_CustomControl {};

class AC_CustomControl_Backend {
public:
    AC_CustomControl_Backend(AC_CustomControl& frontend, AP_AHRS_View*& ahrs, AC_AttitudeControl*& att_control,
                             AP_MotorsMulticopter*& motors, float) :
        _ahrs(ahrs), _att_control(att_control), _motors(motors), _frontend(frontend) {}
    virtual ~AC_CustomControl_Backend() {}
    virtual Vector3f update() = 0;
    virtual void reset() = 0;
    virtual void set_notch_sample_rate(float) {}

protected:
    AP_AHRS_View*& _ahrs;
    AC_AttitudeControl*& _att_control;
    AP_MotorsMulticopter*& _motors;
    AC_CustomControl& _frontend;
};

/* A clock that a test moves. */
namespace AP_HAL { inline uint64_t &micros64() { static uint64_t now = 1000000; return now; } }
struct AP_Logger {
    int lines = 0;
    template <class... A> void Write(const char *, const char *, const char *, A...) { ++lines; }
};
namespace AP { inline AP_Logger &logger() { static AP_Logger one; return one; } }
#define MAV_SEVERITY_WARNING 4
#define GCS_SEND_TEXT(severity, ...) (std::printf(__VA_ARGS__), std::puts(""))
