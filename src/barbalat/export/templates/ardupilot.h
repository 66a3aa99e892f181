/*
 * ${origin}
 * A backend of ArduPilot's AC_CustomControl: see ARDUPILOT.md.
 */
#pragma once

#include "AC_CustomControl_Backend.h"

#if AP_CUSTOMCONTROL_ENABLED

#include "${name}_controller.h"

class AC_CustomControl_${kind} : public AC_CustomControl_Backend {
public:
    AC_CustomControl_${kind}(AC_CustomControl& frontend, AP_AHRS_View*& ahrs, AC_AttitudeControl*& att_control,
                             AP_MotorsMulticopter*& motors, float dt);

    Vector3f update(void) override;
    void reset(void) override;

    static const struct AP_Param::GroupInfo var_info[];

protected:
    // reads the axis's measurement and command [rad, rad/s]; returns whether the angle has jumped by a turn
    bool _measure(float *measured, float *r);
    float *_axis_of(Vector3f &rpy) const;

    ${name}_controller _controller;
    bool _starting; // whether the next update starts the controller
    bool _waiting; // whether the main controller acts until an outage ends
    bool _told; // whether an outage has been reported in this engagement
    uint8_t _logged; // updates since the last log line
    float _at; // [rad] last angle, unwrapped to the revolution of the command
    float _command; // [rad] last command, unwrapped beyond half a turn
    float _u; // the last control
    float _period; // period of the main loop [s]
    uint64_t _last; // [us] time of the last update, if it is measured; 0 after a start
    AP_Int8 _axis;
    AP_Int8 _angle;
    AP_Int16 _fade;
    AP_Float _scale;
${members}};

#endif
