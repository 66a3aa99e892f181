/*
 * ${origin}
 * A backend of ArduPilot's AC_CustomControl: see ARDUPILOT.md.
 */
#include "AC_CustomControl_config.h"
#include "AC_CustomControl_${kind}.h"

#if AP_CUSTOMCONTROL_ENABLED

#include <AP_Logger/AP_Logger.h>
#include <GCS_MAVLink/GCS.h>
#include <string.h>

const AP_Param::GroupInfo AC_CustomControl_${kind}::var_info[] = {
    // @Param: AXIS
    // @DisplayName: Axis
    // @Description: The axis of the controller
    // @Values: 0:Roll, 1:Pitch, 2:Yaw
    // @User: Advanced
    AP_GROUPINFO("AXIS", 1, AC_CustomControl_${kind}, _axis, ${axis}),

    // @Param: ANGLE
    // @DisplayName: Angle is measured
    // @Description: For a controller that measures one number: 1 for the angle, 0 for its rate. Others measure both in this order.
    // @Values: 0:Rate, 1:Angle
    // @User: Advanced
    AP_GROUPINFO("ANGLE", 2, AC_CustomControl_${kind}, _angle, 1),

    // @Param: FADE
    // @DisplayName: Samples of a start
    // @Description: Samples over which the difference from the main controller's output fades out after a start
    // @Range: 0 2000
    // @User: Advanced
    AP_GROUPINFO("FADE", 3, AC_CustomControl_${kind}, _fade, 200),

    // @Param: SCALE
    // @DisplayName: Scale of the control
    // @Description: The controller's u at a motor command of 1
    // @User: Advanced
    AP_GROUPINFO("SCALE", 4, AC_CustomControl_${kind}, _scale, 1.0f),
${infos}
    AP_GROUPEND
};

AC_CustomControl_${kind}::AC_CustomControl_${kind}(AC_CustomControl& frontend, AP_AHRS_View*& ahrs,
                                                   AC_AttitudeControl*& att_control, AP_MotorsMulticopter*& motors, float dt) :
    AC_CustomControl_Backend(frontend, ahrs, att_control, motors, dt),
    _starting(true),
    _waiting(false),
    _told(false),
    _logged(0),
    _at(0.0f),
    _command(0.0f),
    _u(0.0f),
    _period(dt),
    _last(0)
{
    AP_Param::setup_object_defaults(this, var_info);
    ${name}_init(&_controller);
${built}    const float off = dt > ${macro}_SAMPLE_TIME ? dt - ${macro}_SAMPLE_TIME : ${macro}_SAMPLE_TIME - dt;
    if (off > 0.001f * ${macro}_SAMPLE_TIME) {
        GCS_SEND_TEXT(MAV_SEVERITY_WARNING, "${name}: made for a loop rate of ${rate} Hz");
    }
}

${apply}float *AC_CustomControl_${kind}::_axis_of(Vector3f &rpy) const
{
    return _axis.get() <= 0 ? &rpy.x : _axis.get() == 1 ? &rpy.y : &rpy.z;
}

// Angle and rate in the case's units${units_said}. When a heading passes through south, the angle and the command continue beyond
// 180 degrees without a jump. If the angle is more than half a turn from the command, it jumps by one turn, because
// the other way is then shorter.
bool AC_CustomControl_${kind}::_measure(float *measured, float *r)
{
    Quaternion body, target = _att_control->get_attitude_target_quat();
    _ahrs->get_quat_body_to_ned(body);
    Vector3f angle, wanted;
    body.to_euler(angle.x, angle.y, angle.z);
    target.to_euler(wanted.x, wanted.y, wanted.z);
    Vector3f rate = _ahrs->get_gyro_latest();
    Vector3f wanted_rate = (body.inverse() * target) * _att_control->get_attitude_target_ang_vel();
    const bool both = ${both} != 0;
    if (!both && _angle.get() == 0) {
        measured[0] = *_axis_of(rate) * ${first_unit};
        r[0] = *_axis_of(wanted_rate) * ${first_unit};
        return false;
    }
    float command = *_axis_of(wanted), at = *_axis_of(angle);
    command = _starting ? command : _command + wrap_PI(command - _command);
    at = command - wrap_PI(command - at);
    const bool turned = !_starting && fabsf(at - _at) > 3.1415927f;
    if (_starting || turned || fabsf(at - _at) <= 3.1415927f) { // a number
        _command = command;
        _at = at;
    }
    measured[0] = at * ${first_unit};
    measured[${macro}_MEASURED - 1] = both ? *_axis_of(rate) * ${last_unit} : measured[0];
    r[0] = command * ${first_unit};
    return turned;
}

// The output of the main controller is used on the ground and on the other axes. It is also used until the first sample after
// a start is accepted, if the state or the result is rejected, and instead of any fallback of the case.
Vector3f AC_CustomControl_${kind}::update(void)
{
    Vector3f out{_motors->get_roll(), _motors->get_pitch(), _motors->get_yaw()};
    const AP_Motors::SpoolState spool = _motors->get_spool_state();
    if (spool == AP_Motors::SpoolState::SHUT_DOWN || spool == AP_Motors::SpoolState::GROUND_IDLE) {
        reset();
        return out;
    }
    const float scale = _scale.get() > 0.0f ? _scale.get() : 1.0f;
    float x[${macro}_MEASURED], r[${macro}_COMMANDS];
    ${name}_input in;
    ${name}_output result;
    const bool turned = ${read}
${applied}    ${first} = _starting || ${turned};
    if (first) {
        const float u_now[${macro}_INPUTS] = {turned ? _u : *_axis_of(out) * scale};
        if (${name}_start(&_controller, ${start_given}u_now, _fade.get(), turned ? 1 : 0) != ${macro}_OK) {
            _starting = true;
            return out;
        }
        _starting = false;
    }
${timer}    for (int i = 0; i < ${macro}_MEASURED; ++i) {
        in.${measured}[i] = x[i];
    }
    in.r[0] = r[0];
    in.freeze = ${freeze};
    ${status} = ${name}_step(&_controller, &in, &result);
${again}    if (++_logged >= 8) {
        _logged = 0;
        AP::logger().Write("BBLT", "TimeUS,Sta,Y,R,U,ULim", "QIffff", AP_HAL::micros64(), uint32_t(status), double(x[0]),
                           double(r[0]), double(result.u[0]), double(result.u_limited[0]));
        ${name}_log inside;
        ${name}_read_log(&_controller, &inside);
${lines}    }
${handed}    if ((status & (${macro}_STATE_REFUSED | ${macro}_RESULT_REFUSED)) != 0u) {
        reset();
        return out;
    }
    if (first && (status & (${macro}_MEASUREMENT_LOST | ${macro}_COMMAND_LOST)) != 0u) {
        _starting = true; // the first sample or command was lost: nothing has begun
        return out;
    }
    _u = result.u_limited[0];
    *_axis_of(out) = _u / scale;
    return out;
}

// The next update starts at the measured state, without a bump.
void AC_CustomControl_${kind}::reset(void)
{
    _starting = true;
    _waiting = false;
    _told = false;
    _last = 0;
}

#endif
