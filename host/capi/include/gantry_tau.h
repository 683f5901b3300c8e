/*
 * gantry_tau.h: the C interface of gantry-tau, the controller core of Gantry-Tau parallel robots.
 * Written by cbindgen from host/capi/src. Do not edit. First steps: host/capi/README.md. The protocol on the wire: wire.md.
 *
 * MEMORY. The library allocates nothing and frees nothing. Objects (gt_server, gt_l2, gt_f1, gt_f1_tracker, gt_..._compensator,
 * gt_sensor) live in memory of the caller, of GT_..._SIZE bytes (bounds for every target), aligned to GT_ALIGN:
 *
 *     static GT_MEMORY(GT_SERVER_SIZE_3) memory;
 *     gt_server *server;
 *     gt_code code = gt_server_init(&memory, sizeof memory, &config, &start, &server, &error);
 *
 * An object must not be moved or written to; gt_..._copy copies those that have a state. All else is copied: no pointer is kept beyond its
 * call. After an error of gt_..._init do not use an object that was in the memory before.
 *
 * POINTERS. A pointer must point to a value of its type for the duration of the call. Null is refused with GT_CODE_NULL_POINTER unless
 * documented as allowed, a misaligned pointer with GT_CODE_MISALIGNED (one that may be null counts as null), a handle without a live
 * object of its type with GT_CODE_NO_OBJECT. `error` may always be null; it receives the details of the returned code, GT_CODE_OK included.
 * A call that returns an error writes no other results and changes nothing, unless documented otherwise.
 *
 * THREADS. The library has no global state. Calls on different objects are independent. Calls on one gt_server, gt_f1_tracker or
 * gt_sensor must not overlap; no call changes a machine or a compensator, so threads may share them.
 *
 * TIME. No call blocks, locks, allocates, or calls back into C. Every loop is bounded by a constant or by a length from the caller.
 *
 * FLOATING POINT. Any number may be passed, NaN and infinities included: the result is an error, never undefined behaviour. Results are
 * finite. All functions may be called from interrupts that save the floating-point registers. The environment must be the one that C starts
 * with, exceptions masked: with one unmasked (feenableexcept), NaN or an unreachable pose is a trap (SIGFPE) and not an error; use feholdexcept
 * and fesetenv around calls then. Rounding mode, flush-to-zero and the precision of the x87 change no position by a nanometre in the tests.
 *
 * PADDING of every result is zero.
 *
 * UNITS. References, and positions of axes in kinematics and compensation, are integers: nm, um/s and per mille of rated torque. Poses
 * and loads are in SI units. Data of a machine, Jacobians, and loads on axes are per q-unit: metres for a cart whose guideway has unit
 * length, radians for plates; metres_per_q of a geometry converts. Axes, arms, links and motors count from 0.
 */


#ifndef GANTRY_TAU_H
#define GANTRY_TAU_H

#include <stddef.h>
#include <stdint.h>

/* Memory for an object, for static or automatic storage, with sufficient alignment. */
#define GT_MEMORY(size) union { long double alignment; unsigned char bytes[size]; }


// Version of this interface. It changes with every change to a type, a constant or the meaning of
// a function.
#define GT_ABI_VERSION 9

// Longest part of a black box, bytes.
#define GT_BLACK_BOX_PART 4096

// Bytes of a gt_l2_compensator.
#define GT_L2_COMPENSATOR_SIZE 4096

// Bytes of a gt_f1_compensator.
#define GT_F1_COMPENSATOR_SIZE 2560

// Bytes of a gt_f1.
#define GT_F1_SIZE 2048

// Bytes of a gt_f1_tracker.
#define GT_F1_TRACKER_SIZE 2048

// Bytes of a gt_l2.
#define GT_L2_SIZE 2048

// Number of links, in the order 11, 21, 22, 31, 32, 33: the first digit is the arm, and its number
// of links.
#define GT_LINKS 6

// Number of arms, carts and guideways.
#define GT_ARMS 3

// Alignment for every object on every target; that of malloc and GT_MEMORY.
#define GT_ALIGN 16

// Bytes of a gt_sensor.
#define GT_SENSOR_SIZE 1536

// Length of arrays per axis.
#define GT_MAX_AXES 6

// Length of arrays per motor.
#define GT_MAX_MOTORS 12

// Connections that can be open at once: the owner, and others that are told why they cannot be.
#define GT_MAX_CONNECTIONS 6

// TCP and the like: bytes come in pieces of any length. A broken frame ends the connection, and
// its session.
#define GT_TRANSPORT_STREAM 0

// UDP and the like: each gt_server_feed is one whole datagram. A broken one is dropped.
#define GT_TRANSPORT_DATAGRAM 1

// No black box.
#define GT_BLACK_BOX_NONE 0

// A black box of at least this many ticks before the end of a session, and as many after it.
#define GT_BLACK_BOX_TICKS 64

// Bytes of a server with 3 axes and no black box, on any target.
#define GT_SERVER_SIZE_3 9984

// Bytes of a server with 6 axes and no black box.
#define GT_SERVER_SIZE_6 13312

// Bytes of a server with 3 axes and a black box.
#define GT_SERVER_SIZE_3_BLACK_BOX 400128

// Bytes of a server with 6 axes and a black box, the largest server.
#define GT_SERVER_SIZE_6_BLACK_BOX 595456

// Largest distance of a drive from what gt_start says is in force, nm.
#define GT_START_WINDOW_NM 1000000

// Longest frame, bytes.
#define GT_MAX_FRAME 408

// Keys of a server at most.
#define GT_MAX_KEYS 4

// Bytes of a secret.
#define GT_SECRET 32

// Bytes of the name of a key.
#define GT_KEY_ID 8

// Bytes of an address and port: an IPv6 address, or that of IPv4 as it is mapped into IPv6, and the
// port, big-endian.
#define GT_PEER 18

// The holder may have a session.
#define GT_ROLE_CONTROL 1

// The holder may read, and gets no session.
#define GT_ROLE_READ 2

// The datagram is not answered.
#define GT_GREETED_NOTHING 1

// The frame is to be sent to the peer, of which nothing is remembered.
#define GT_GREETED_ANSWER 2

// The peer has a place: frame.connection is its connection, and there is nothing to be sent.
#define GT_GREETED_PEER 3

// The reference was clamped to the machine's travel.
#define GT_FLAG_TRAVEL 1

// The position offset could not reach its target within step and accel.
#define GT_FLAG_POSITION_LIMITED 2

// The same for the velocity offset.
#define GT_FLAG_VELOCITY_LIMITED 4

// The same for the torque offset.
#define GT_FLAG_TORQUE_LIMITED 8

// The nominal reference stepped further than nominal_step_nm.
#define GT_FLAG_NOMINAL_STEP 16

// The nominal reference accelerated more than nominal_accel_nm.
#define GT_FLAG_NOMINAL_ACCEL 32

// The switch or button is released.
#define GT_RELEASED 1

// The switch or button is pressed.
#define GT_PRESSED 2

// The machine was read.
#define GT_READING_DONE 1

// The machine could not be read: `nominal_nm` and `actual` are not looked at.
#define GT_READING_FAILED 2

// The drives took the references.
#define GT_WRITE_ACCEPTED 1

// The drives did not take them, which stops; they were read back and have the values of
// `in_force`.
#define GT_WRITE_REFUSED 2

// The drives did not take them, which stops, and cannot be read back.
#define GT_WRITE_UNKNOWN 3

// There is no sample.
#define GT_SAMPLE_NONE 0

// There is a sample.
#define GT_SAMPLE_DONE 1

// There is a sample, with a component that was cut to its range: not to be used as a measurement.
#define GT_SAMPLE_CUT 2

// Result of a call: 0 for success, else the error; gt_error has its details. Axes, arms, links and
// motors count from 0.
enum gt_code
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Done.
  GT_CODE_OK = 0,
  // A required pointer is null.
  GT_CODE_NULL_POINTER = 1,
  // A pointer is not aligned for its type.
  GT_CODE_MISALIGNED = 2,
  // The memory is smaller than the object. `value`: bytes needed.
  GT_CODE_MEMORY_TOO_SMALL = 3,
  // The handle does not refer to a live object of this type.
  GT_CODE_NO_OBJECT = 4,
  // A length is above the largest size of an object.
  GT_CODE_LENGTH = 5,
  // A buffer is too small. `value`: bytes needed.
  GT_CODE_BUFFER_TOO_SMALL = 6,
  // The index is beyond the last entry.
  GT_CODE_INDEX = 7,
  // The transport is neither GT_TRANSPORT_STREAM nor GT_TRANSPORT_DATAGRAM.
  GT_CODE_TRANSPORT = 8,
  // The number of motors is not 1 to GT_MAX_MOTORS. `value`: the refused number.
  GT_CODE_MOTOR_COUNT = 9,
  // black_box_ticks is neither GT_BLACK_BOX_NONE nor GT_BLACK_BOX_TICKS. `value`: the refused
  // number.
  GT_CODE_BLACK_BOX = 10,
  // A branch or a sign is neither 1 nor -1. `index`: its number.
  GT_CODE_BRANCH = 11,
  // A field of a gt_tick_input is not one of its values; 0 is refused. `parameter`:
  // GT_PARAMETER_READING, GT_PARAMETER_SENSOR, GT_PARAMETER_STOP or GT_PARAMETER_REARM, `value`:
  // the refused number.
  GT_CODE_TICK_INPUT = 12,
  // All frames or connections have been polled: the end of a loop, not an error.
  GT_CODE_DONE = 13,
  // An error of core without a code of its own.
  GT_CODE_OTHER = 14,
  // There are no references of which nothing was said: no tick has run since they were spoken
  // of, or its frames were polled, which makes them unknown. Nothing has changed.
  GT_CODE_NOT_PENDING = 15,
  // Accepted was said of a tick without references: taken for unknown.
  GT_CODE_WITHHELD = 16,
  // The fate of the references is not one of its values; 0 is refused. They still wait for it.
  GT_CODE_WRITE = 17,
  // The memory of a copy overlaps the object.
  GT_CODE_OVERLAP = 18,
  // M of a channel is negative. `index`: axis, `parameter`: channel, `value`: M.
  GT_CODE_LIMITS_NEGATIVE_MAX = 100,
  // rho of a channel is zero or negative. `index`: axis, `parameter`: channel, `value`: rho.
  GT_CODE_LIMITS_RAMP_NOT_POSITIVE = 101,
  // rho of a channel is above S. `index`: axis, `parameter`: channel, `value`: rho, `upper`: S.
  GT_CODE_LIMITS_RAMP_ABOVE_STEP = 102,
  // A of a channel is below S + rho. `index`: axis, `parameter`: channel, `value`: A, `lower`: S
  // + rho.
  GT_CODE_LIMITS_ACCEL_TOO_SMALL = 103,
  // The number of axes is neither 3 nor 6. `value`: the refused number.
  GT_CODE_CONFIG_AXES = 200,
  // handshake_ticks is 0: every session would time out at once.
  GT_CODE_CONFIG_HANDSHAKE_TICKS = 201,
  // The window of the miss budget is above 128 ticks. `value`: the window.
  GT_CODE_CONFIG_BUDGET_WINDOW = 202,
  // M of a torque channel does not fit 16 bits. `index`: axis.
  GT_CODE_CONFIG_TORQUE_MAX = 203,
  // A travel has its ends reversed, or beyond 2^61 nm. `index`: axis.
  GT_CODE_CONFIG_TRAVEL = 204,
  // The nominal travel is less than M of the position channel inside the machine's travel.
  // `index`: axis.
  GT_CODE_CONFIG_MARGIN = 205,
  // The agitation budget is above 1000000 nm per tick. `index`: axis, `value`: the budget.
  GT_CODE_CONFIG_AGITATION = 206,
  // An offset in force is beyond its limits: the server must not start. `index`: axis, `value`:
  // its position offset in nm, `lower`: velocity in um/s, `upper`: torque in per mille.
  GT_CODE_START_OFFSET_IN_FORCE = 300,
  // The first tick has no reading, or an axis stands further than GT_START_WINDOW_NM from what
  // gt_start says is in force. Nothing may be written. `index`: axis, or -1 without a reading,
  // `value`: distance, nm.
  GT_CODE_START_DISAGREES = 301,
  // A motor is mapped to an axis beyond the last one. `index`: motor, `value`: the axis,
  // `upper`: number of axes.
  GT_CODE_MOTOR_MAP = 400,
  // GT_MAX_CONNECTIONS are open. Send the frame of gt_server_refusal to the peer.
  GT_CODE_FULL = 500,
  // A number of a machine is NaN or infinite. `parameter`, `index`: its place.
  GT_CODE_ROBOT_NOT_FINITE = 600,
  // The magnitude of a number of a machine is outside `lower` to `upper`. `parameter`, `index`:
  // its place.
  GT_CODE_ROBOT_OUT_OF_RANGE = 601,
  // The lower end of a travel is above its upper end. `parameter`, `index`: its place.
  GT_CODE_ROBOT_REVERSED = 602,
  // The matrix of an orientation is not a rotation matrix. `value`: largest deviation of R^T R
  // from the identity.
  GT_CODE_ORIENTATION_NOT_ROTATION = 700,
  // The Tau property is violated. `index`: the link that differs from the first of its cluster,
  // `value`: the difference, m.
  GT_CODE_ORIENTATION_NOT_TAU = 701,
  // The gain is outside 0 to 1.
  GT_CODE_COMPENSATOR_GAIN = 800,
  // A limit is negative. `index`: axis.
  GT_CODE_COMPENSATOR_LIMIT = 801,
  // metres_per_q is not finite or out of range. `index`: axis. Not returned by this interface,
  // where a machine has checked it.
  GT_CODE_COMPENSATOR_METRES_PER_Q = 802,
  // An argument, or a number computed from it, is NaN or infinite.
  GT_CODE_KINEMATICS_NOT_FINITE = 900,
  // The links of an arm are too short to reach the pose. `index`: arm.
  GT_CODE_KINEMATICS_UNREACHABLE = 901,
  // The links cannot meet for these positions of the carts.
  GT_CODE_KINEMATICS_NO_ASSEMBLY = 902,
  // The pose exists only beyond a singularity. `index`: the arm on the other side of it, -1 for
  // the tool.
  GT_CODE_KINEMATICS_OTHER_BRANCH = 903,
  // The pose is singular, or too close to it. `value`: the measure, 0 at the singularity.
  GT_CODE_KINEMATICS_SINGULAR = 904,
  // An axis would leave its travel. `index`: axis, `value`: its position, `lower`, `upper`: its
  // travel; q-units.
  GT_CODE_KINEMATICS_OUT_OF_RANGE = 905,
  // The iteration did not converge. `iterations`: their number, `value`: largest error of a
  // link's length, m.
  GT_CODE_KINEMATICS_NOT_CONVERGED = 906,
  // The machine has no synchronised form: a tracker needs gt_f1_tracker_start_from.
  GT_CODE_KINEMATICS_SEED_REQUIRED = 907,
  // Pose and positions do not match the length of an arm's links. `index`: arm.
  GT_CODE_KINEMATICS_INCONSISTENT = 908,
  // The rotation of a sensor's mounting is not a rotation matrix.
  GT_CODE_SENSOR_NOT_ROTATION = 1000,
  // A number of a sensor is outside `lower` to `upper`. `parameter`: its name.
  GT_CODE_SENSOR_OUT_OF_RANGE = 1001,
  // A component of a reading is NaN, infinite or beyond 1e6; the reading was not used.
  GT_CODE_SENSOR_BAD_READING = 1002,
  // The state of a sensor is invalid. Not returned by this interface, where that state never
  // comes from outside.
  GT_CODE_SENSOR_INVALID_STATE = 1003,
  // The platform's rotation is not a rotation matrix.
  GT_CODE_SENSOR_PLATFORM_NOT_ROTATION = 1004,
  // A length to convert is NaN or infinite.
  GT_CODE_CROSSING_NOT_FINITE = 1100,
  // A length to convert is out of range. `upper`: largest magnitude, nm.
  GT_CODE_CROSSING_OUT_OF_RANGE = 1101,
  // The text is not that of a key. `value`: number of the first wrong line.
  GT_CODE_KEY_TEXT = 1200,
  // The number of keys is not 1 to GT_MAX_KEYS. `value`: the refused number.
  GT_CODE_KEY_COUNT = 1201,
  // The role of a key is not one of its values; 0 is refused. `index`: its number, `value`: the
  // role.
  GT_CODE_KEY_ROLE = 1202,
  // A key is given twice. `index`: the second one.
  GT_CODE_KEY_TWICE = 1203,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_code gt_code;
#else
typedef int32_t gt_code;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Parameter that an error is about.
enum gt_parameter
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // None, or implied by the code.
  GT_PARAMETER_NONE = 0,
  // cart_joints_m; the index is the link.
  GT_PARAMETER_CART_JOINT = 1,
  // guideways; the index is the arm.
  GT_PARAMETER_GUIDEWAY = 2,
  // platform_joints_m; the index is the link.
  GT_PARAMETER_PLATFORM_JOINT = 3,
  // lengths_m; the index is the arm (L2) or the link (F1).
  GT_PARAMETER_LENGTH = 4,
  // travel; the index is the axis.
  GT_PARAMETER_TRAVEL = 5,
  // link_m_per_n; the index is the link.
  GT_PARAMETER_LINK_COMPLIANCE = 6,
  // axis_per_n; the index is the axis.
  GT_PARAMETER_CART_COMPLIANCE = 7,
  // carts_m; the index is the arm.
  GT_PARAMETER_CART = 8,
  // plate_joints_m; the index is the link.
  GT_PARAMETER_PLATE_JOINT = 9,
  // turn_axis.
  GT_PARAMETER_TURN_AXIS = 10,
  // tilt_axis.
  GT_PARAMETER_TILT_AXIS = 11,
  // lever_m of a sensor.
  GT_PARAMETER_LEVER = 12,
  // cutoff_hz of a sensor.
  GT_PARAMETER_CUTOFF = 13,
  // cycle_s of a sensor.
  GT_PARAMETER_CYCLE = 14,
  // tare_samples of a sensor.
  GT_PARAMETER_TARE_SAMPLES = 15,
  // The position channel; the index is the axis.
  GT_PARAMETER_POSITION = 16,
  // The velocity channel; the index is the axis.
  GT_PARAMETER_VELOCITY = 17,
  // The torque channel; the index is the axis.
  GT_PARAMETER_TORQUE = 18,
  // metres_per_q; the index is the axis.
  GT_PARAMETER_METRES_PER_Q = 19,
  // `stop` of a gt_tick_input.
  GT_PARAMETER_STOP = 20,
  // `rearm` of a gt_tick_input.
  GT_PARAMETER_REARM = 21,
  // `reading` of a gt_tick_input.
  GT_PARAMETER_READING = 23,
  // tool_weight_n of a sensor.
  GT_PARAMETER_TOOL_WEIGHT = 24,
  // tool_centre_m of a sensor.
  GT_PARAMETER_TOOL_CENTRE = 25,
  // order of a sensor's low-pass.
  GT_PARAMETER_ORDER = 26,
  // Frequency of a notch.
  GT_PARAMETER_NOTCH_FREQUENCY = 27,
  // Q of a notch.
  GT_PARAMETER_NOTCH_Q = 28,
  // `status` of the sensor of a gt_tick_input.
  GT_PARAMETER_SENSOR = 29,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_parameter gt_parameter;
#else
typedef int32_t gt_parameter;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Cause of the end of a session; numbers as on the wire.
enum gt_cause
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // No session has ended.
  GT_CAUSE_NONE = 0,
  // Two consecutive deadlines passed without a Command.
  GT_CAUSE_CLIENT_LATE = 1,
  // Two consecutive deadlines passed; Commands arrived, but late.
  GT_CAUSE_NETWORK_LATE = 2,
  // The server overran its own cycle.
  GT_CAUSE_SERVER_LATE = 3,
  // A broken frame boundary, checksum or tag on the owner's stream.
  GT_CAUSE_MALFORMED = 4,
  // The owner's connection was closed, or could not take a State.
  GT_CAUSE_CLOSED = 5,
  // The owner said goodbye.
  GT_CAUSE_GOODBYE = 6,
  // More misses within the window than the budget allows.
  GT_CAUSE_BUDGET = 7,
  // A stop, at the machine or by the owner.
  GT_CAUSE_STOP = 8,
  // The nominal reference stepped further than its limit.
  GT_CAUSE_NOMINAL = 9,
  // The owner sent more frames in one tick than are read.
  GT_CAUSE_FLOOD = 10,
  // No Command followed the Welcome in time.
  GT_CAUSE_HANDSHAKE_TIMEOUT = 11,
  // Offsets were in force that the server did not expect: at its start, or after a refused
  // write.
  GT_CAUSE_RESTART = 12,
  // The position offset of an axis was shaken by more than its agitation budget allows.
  GT_CAUSE_AGITATED = 13,
  // A cause without a number of its own here.
  GT_CAUSE_OTHER = 255,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_cause gt_cause;
#else
typedef int32_t gt_cause;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Phases of a session; numbers as on the wire.
enum gt_phase
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // No session. All offsets are zero.
  GT_PHASE_LISTENING = 0,
  // A session is granted, its first Command is awaited. All offsets are zero.
  GT_PHASE_HANDSHAKE = 1,
  // Commands move a shadow that is only reported. All offsets are zero.
  GT_PHASE_SUBMIT = 2,
  // Commands move the references.
  GT_PHASE_OBTAIN = 3,
  // The session is over, every offset ramps to zero.
  GT_PHASE_SAFE_DISCONNECT = 4,
  // Stopped: every offset ramps to zero, and only a local re-arm leads out.
  GT_PHASE_FAULT = 5,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_phase gt_phase;
#else
typedef int32_t gt_phase;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A machine with six axes; its memory is the caller's, and no call changes it: threads may share
// it.
typedef struct gt_f1 gt_f1;

// A compensator of a machine with six axes; no call changes it: threads may share it.
typedef struct gt_f1_compensator gt_f1_compensator;

// Forward kinematics of a machine with six axes, cycle by cycle: each pose is found from the last
// one, which is kept inside.
typedef struct gt_f1_tracker gt_f1_tracker;

// A machine with three axes; its memory is the caller's, and no call changes it: threads may share
// it.
typedef struct gt_l2 gt_l2;

// A compensator of a machine with three axes; no call changes it: threads may share it.
typedef struct gt_l2_compensator gt_l2_compensator;

// A force sensor.
typedef struct gt_sensor gt_sensor;

// A server; its memory is the caller's.
typedef struct gt_server gt_server;

// Compliances of a machine, and the share of its deflection that is corrected. Array entries
// beyond the machine's axes are not read.
typedef struct gt_compensator_config {
  // Elongation of each link per newton of tension, m/N, link order; positive.
  double link_m_per_n[GT_LINKS];
  // Displacement of each axis per unit of load, q-units (carts: m/N, plates: rad/(N m));
  // positive.
  double axis_per_n[GT_MAX_AXES];
  // Largest magnitude of each axis' offset, nm; 0 means 0.
  int32_t limits_nm[GT_MAX_AXES];
  // Share of the computed displacement that is corrected, 0 to 1. Against a workpiece of
  // stiffness K a measured load fed back is stable only while the estimated compliance stays
  // below the machine's plus 1/K.
  double gain;
} gt_compensator_config;

// Details of an error. The meaning of a field depends on the code; a field that the code does not
// use is 0.
typedef struct gt_error {
  // The code that the call returned, GT_CODE_OK included.
  gt_code code;
  // Axis, arm, link or motor, counted from 0; -1 for none.
  int32_t index;
  // Parameter.
  gt_parameter parameter;
  // Number of linear solves.
  int32_t iterations;
  // Refused value, or a measure of its error.
  double value;
  // Smallest accepted value.
  double lower;
  // Largest accepted value.
  double upper;
} gt_error;

// A load on the platform, applied BY THE ENVIRONMENT TO THE PLATFORM; moment about the tool centre
// point.
typedef struct gt_wrench {
  // F, N; world axes.
  double force_n[3];
  // M, N m; world axes.
  double moment_nm[3];
} gt_wrench;

// Offsets of one cycle.
typedef struct gt_correction {
  // Offset of each axis, nm, within its limit; 0 beyond the machine's axes.
  int32_t offsets_nm[GT_MAX_AXES];
  // 1 for an offset that its limit has cut.
  uint8_t saturated[GT_MAX_AXES];
} gt_correction;

// Geometry of a machine with six axes. Joints on the plates: A_ij = C_i + q_i V_i + Q_i P_ij,
// where plate 2 is turned by Rot(ax, sigma4 q4), plate 3 by Rot(ax, sigma5 q5) Rot(ax6, q6), plate
// 1 not at all. World axes, m.
typedef struct gt_f1_geometry {
  // C: origins of the carts' plates at q = 0.
  double carts_m[GT_ARMS][3];
  // V: directions of the guideways, m per unit of q.
  double guideways[GT_ARMS][3];
  // P: joints on the plates from the plate's origin, plate axes, link order.
  double plate_joints_m[GT_LINKS][3];
  // b: joints on the platform from the tool centre point, platform axes, link order.
  double platform_joints_m[GT_LINKS][3];
  // L: length of each link, link order.
  double lengths_m[GT_LINKS];
  // Side of each guideway the links point to: 1 or -1.
  int32_t inverse_branch[GT_ARMS];
  // ax: axis about which plates 2 and 3 turn, of any length.
  double turn_axis[3];
  // ax6: axis about which plate 3 tilts, in axes of the turned plate, of any length.
  double tilt_axis[3];
  // sigma4, sigma5: directions of plates 2 and 3 for positive q4, q5: 1 or -1.
  int32_t turn_signs[2];
  // 0: travel of carts is not checked; plates stay within half a turn.
  uint8_t has_travel;
  // Range of each q, lower and upper end, q-units; rad for the last three.
  double travel[6][2];
  // Length of one unit of each q by the drives' count, m: |V_i| to a percent for a cart, the
  // screw's law for a plate.
  double metres_per_q[6];
} gt_f1_geometry;

// Position and orientation of the tool: x_world = T + R x_platform.
typedef struct gt_pose {
  // T: tool centre point, world axes, m.
  double position_m[3];
  // R: world axes from platform axes, row by row.
  double rotation[3][3];
} gt_pose;

// Effort and accuracy of an iterative solution.
typedef struct gt_solved {
  // Number of linear solves.
  int32_t iterations;
  // Largest error of a link's length, m.
  double residual_m;
} gt_solved;

// Geometry of a machine with three axes: joints on the carts A_ij = A0_ij + q_i v_i, on the
// platform B_ij = T + R b_ij. World axes, m.
typedef struct gt_l2_geometry {
  // A0: joints on the carts at q = 0, link order.
  double cart_joints_m[GT_LINKS][3];
  // v: directions of the guideways, m per unit of q.
  double guideways[GT_ARMS][3];
  // b: joints on the platform from the tool centre point, platform axes, link order.
  double platform_joints_m[GT_LINKS][3];
  // L: link length of each arm.
  double lengths_m[GT_ARMS];
  // R: world axes from platform axes, row by row; constant.
  double rotation[3][3];
  // Side of each guideway the links point to, sign(s_i . v_i): 1 or -1.
  int32_t inverse_branch[GT_ARMS];
  // Side of the carts' plane the tool is on, sign(n . (T - P_1)), n = (P_2 - P_1) x (P_3 - P_1):
  // 1 or -1.
  int32_t forward_branch;
  // 0: the travel of q is not checked.
  uint8_t has_travel;
  // Range of each q, lower and upper end, q-units.
  double travel[GT_ARMS][2];
  // Length of one unit of each q by the drives' count, m: |v_i| to a percent.
  double metres_per_q[GT_ARMS];
} gt_l2_geometry;

// Mounting and filter of a sensor.
typedef struct gt_sensor_config {
  // R_s: platform axes from sensor axes, row by row.
  double rotation[3][3];
  // p: from the tool centre point to the sensor's origin, platform axes, m; at most 10.
  double lever_m[3];
  // G: weight of what the sensor carries, a force, world axes, N; at most 1e5. Zero where it is
  // not known, and so is tared.
  double tool_weight_n[3];
  // c: from the tool centre point to its centre of gravity, platform axes, m; at most 10.
  double tool_centre_m[3];
  // Cut-off frequency of the low-pass, Hz, 1e-3 to 1e5, or to 0.45 / cycle_s of second order.
  double cutoff_hz;
  // Time between two samples, s, 1e-6 to 10.
  double cycle_s;
  // Samples of the tare, 1 to 1e6; the tool must be unloaded meanwhile.
  uint32_t tare_samples;
  // Order of the low-pass: 1, or 2 (Butterworth), which can have notches.
  uint32_t order;
} gt_sensor_config;

// Limits of one offset channel: 0 < ramp <= step, step + ramp <= accel, max >= 0.
// Units: nm, um/s or per mille of rated torque, by the channel; per tick.
typedef struct gt_limits {
  // M: largest magnitude; 0 disables the channel.
  int32_t max;
  // S: largest change per tick.
  int32_t step;
  // A: largest change of the change per tick.
  int32_t accel;
  // rho: change per tick on the way back to zero.
  int32_t ramp;
} gt_limits;

// Limits of one axis.
typedef struct gt_axis_config {
  // Position offset, nm.
  struct gt_limits position;
  // Velocity offset, um/s.
  struct gt_limits velocity;
  // Torque offset, per mille of rated torque.
  struct gt_limits torque;
  // Range of the nominal reference, lower end, nm.
  int64_t nominal_lower_nm;
  // Upper end.
  int64_t nominal_upper_nm;
  // Range of the drive's reference, lower end, nm. At both ends at least position.max wider than
  // the nominal range.
  int64_t machine_lower_nm;
  // Upper end.
  int64_t machine_upper_nm;
  // Largest change of the nominal reference per tick, nm. 0: it must not move.
  uint32_t nominal_step_nm;
  // Largest second difference of the nominal reference, nm per tick^2, of two ticks on time; more
  // sets GT_FLAG_NOMINAL_ACCEL. 0: it is not looked at.
  uint32_t nominal_accel_nm;
  // Agitation budget: second differences of the position offset that can go on for ever, nm per
  // tick; a thousand times as much at once ends the session (GT_CAUSE_AGITATED). At most
  // 1000000; 0: no budget.
  uint32_t agitation_nm_per_tick;
  // Not 0: more than nominal_accel_nm stops the machine, as more than nominal_step_nm does.
  uint8_t nominal_accel_is_fault;
} gt_axis_config;

// Configuration of a server. gt_server_config_thesis fills one.
typedef struct gt_server_config {
  // Number of axes, 3 (L2) or 6 (F1). Of every array per axis, only the first `axes` entries are
  // read.
  uint32_t axes;
  // Number of motors, 1 to GT_MAX_MOTORS.
  uint32_t motors;
  // Axis of each motor, counted from 0. Two motors on one cart have the same axis and always
  // receive equal references.
  uint8_t axis_of_motor[GT_MAX_MOTORS];
  // GT_BLACK_BOX_NONE, or GT_BLACK_BOX_TICKS: number of ticks kept before and after the end of a
  // session.
  uint32_t black_box_ticks;
  // Length of a cycle, us. Reported to the client; the library has no clock.
  uint32_t cycle_us;
  // Ticks that a granted session waits for its first Command; at least 1.
  uint32_t handshake_ticks;
  // Checksum of the kinematic parameters, reported to the client: gt_l2_checksum,
  // gt_f1_checksum, or 0.
  uint32_t kinematics_checksum;
  // Abilities of the server: 0, or 1 for lock-step. A client must have the same.
  uint16_t capabilities;
  // Number of ticks that the echo of a Command may be behind the last State; usually 0.
  uint8_t echo_window;
  // Window of the miss budget in ticks, 1 to 128; 0: no budget beside the rule of two in a row.
  uint8_t budget_window;
  // Misses tolerated within any such window; one more ends the session.
  uint8_t budget_allowed;
  // The axes.
  struct gt_axis_config axis[GT_MAX_AXES];
} gt_server_config;

// The external offsets of one axis.
typedef struct gt_offsets {
  // Added to the position reference (CiA 402 object 60B0h), nm.
  int32_t position_nm;
  // Added to the velocity reference (60B1h), um/s.
  int32_t velocity_um_s;
  // Added to the torque reference (60B2h), per mille of rated torque.
  int16_t torque_permille;
} gt_offsets;

// Values in force at the drive of one axis.
typedef struct gt_in_force {
  // Nominal reference, without offset, nm.
  int64_t nominal_nm;
  // Offsets.
  struct gt_offsets offsets;
} gt_in_force;

// State of the machine at the start of a server.
typedef struct gt_start {
  // Values in force at the drives, read back from them. Nonzero offsets ramp to zero before a
  // session is granted.
  struct gt_in_force in_force[GT_MAX_AXES];
  // First epoch that may be granted. Epochs come from a counter in storage that survives a
  // restart: reserve a range, write the counter back, then start the server.
  uint64_t first_epoch;
  // Last epoch of the range; below first_epoch for none. gt_server_set_epochs extends it.
  uint64_t last_epoch;
  // Not 0: a stop was asserted before and has not been re-armed. The server then starts in
  // GT_PHASE_FAULT.
  uint8_t stop_latched;
} gt_start;

// A shared secret.
typedef struct gt_key {
  // 32 random bytes.
  uint8_t secret[GT_SECRET];
  // GT_ROLE_CONTROL or GT_ROLE_READ.
  uint8_t role;
} gt_key;

// Keys of a server.
typedef struct gt_keys {
  // Number of the keys, 1 to GT_MAX_KEYS.
  uint32_t count;
  // The keys; those from `count` on are not read.
  struct gt_key keys[GT_MAX_KEYS];
  // Random bytes of this start; on a target without random numbers a constant, if its epochs never
  // repeat.
  uint8_t start_secret[GT_SECRET];
  // Tags that are computed per tick of datagrams from the owner's address; 0: 16.
  uint8_t tags;
  // Hellos that are judged per tick; 0: 4.
  uint8_t greetings;
} gt_keys;

// A frame to be sent on a connection.
typedef struct gt_frame {
  // Recipient.
  uint64_t connection;
  // Number of bytes.
  uint32_t length;
  // The bytes; 0 from `length` on.
  uint8_t bytes[GT_MAX_FRAME];
} gt_frame;

// Result of gt_server_greet.
typedef struct gt_greeting {
  // GT_GREETED_NOTHING, GT_GREETED_ANSWER or GT_GREETED_PEER.
  uint32_t what;
  // The answer, or the number of the connection.
  struct gt_frame frame;
} gt_greeting;

// Sample of the force sensor. The server decides nothing by it: its State carries it to the client.
typedef struct gt_wrench_sample {
  // GT_SAMPLE_NONE: the rest is not looked at; GT_SAMPLE_DONE or GT_SAMPLE_CUT.
  uint8_t status;
  // Ticks since it was measured: 0 in this tick, 255 for 255 or more.
  uint8_t age;
  // Force, the sensor's axes, mN.
  int32_t force_mn[3];
  // Moment about the sensor's origin, the sensor's axes, uN m.
  int32_t moment_unm[3];
} gt_wrench_sample;

// Measurements of a drive.
typedef struct gt_actual {
  // Position of the motor side of the axis, nm.
  int64_t position_nm;
  // Velocity, um/s.
  int32_t velocity_um_s;
  // Torque, per mille of rated torque.
  int16_t torque_permille;
} gt_actual;

// Inputs of one tick. Zero is refused where a forgotten value would be dangerous: reading, stop,
// rearm.
typedef struct gt_tick_input {
  // Cycles since the last tick: 1 when on time; each further one is a missed deadline. 0 counts
  // as 1.
  uint32_t elapsed_cycles;
  // GT_READING_DONE, or GT_READING_FAILED: then the server stops, and the last nominal
  // references stand until the path comes back to them.
  uint8_t reading;
  // The stop at the machine: GT_RELEASED or GT_PRESSED.
  uint8_t stop;
  // Not 0: the program is to end, which ramps as a stop does and latches nothing. Hold it until
  // the program ends.
  uint8_t quit;
  // The re-arm at the machine: GT_RELEASED or GT_PRESSED. It counts only after it was seen
  // released in Fault.
  uint8_t rearm;
  // Sample of the force sensor, for the client; zero without one.
  struct gt_wrench_sample sensor;
  // Nominal references of this cycle, nm.
  int64_t nominal_nm[GT_MAX_AXES];
  // Measurements of the drives.
  struct gt_actual actual[GT_MAX_AXES];
} gt_tick_input;

// References that one motor's drive receives.
typedef struct gt_reference {
  // Position reference: nominal plus offset, inside the machine's travel, nm.
  int64_t position_nm;
  // Additive velocity reference, um/s.
  int32_t velocity_offset_um_s;
  // Additive torque reference, per mille of rated torque.
  int16_t torque_offset_permille;
} gt_reference;

// Counts since the session was granted; they saturate.
typedef struct gt_counters {
  // Frames of the owner, valid or not.
  uint32_t received;
  // Deadlines that passed without a fresh valid Command.
  uint32_t missed;
  // Commands for a tick already past, or overtaken in the same tick.
  uint32_t late;
  // Commands with the sequence of one that was accepted.
  uint32_t duplicate;
  // Frames of another epoch, out of sequence, or echoing a tick that was never sent.
  uint32_t stale;
  // Frames of the owner with bad content, or not allowed in the phase.
  uint32_t malformed;
  // Commands refused because a target lies beyond M.
  uint32_t out_of_range;
  // Channel steps that step or accel held back.
  uint32_t limited;
  // References that the travel clamped.
  uint32_t clamped;
  // Frames of non-owners, Hellos aside.
  uint32_t non_owner;
  // Longest run of consecutive misses.
  uint16_t longest_miss_run;
} gt_counters;

// One axis after a tick.
typedef struct gt_axis_state {
  // Nominal reference, without offset, nm.
  int64_t nominal_nm;
  // Offsets in force.
  struct gt_offsets offsets;
  // Offsets that would be in force if Submit were Obtain; zero outside Submit.
  struct gt_offsets shadow;
  // Measurements of the drive.
  struct gt_actual actual;
  // Values that were clamped or limited in this tick: GT_FLAG_ bits.
  uint8_t flags;
} gt_axis_state;

// State of the server after a tick, as the owner receives it.
typedef struct gt_state {
  // Number of this tick.
  uint64_t tick;
  // Epoch of the current or last session.
  uint64_t epoch;
  // Sequence of the last accepted Command; 0 before the first.
  uint64_t accepted;
  // The phase.
  gt_phase phase;
  // Cause of the end of the last session; it stays until the next end.
  gt_cause cause;
  // Ticks until every offset would be zero if the ramp began now.
  uint32_t ramp_ticks_left;
  // Arrival of the last Command, us, as given.
  uint16_t arrival_us;
  // On-time Commands among the last 100 deadlines.
  uint8_t on_time_of_100;
  // Counts since the session was granted.
  struct gt_counters counters;
  // Sample of the force sensor, as given.
  struct gt_wrench_sample sensor;
  // Number of axes.
  uint32_t axis_count;
  // The axes; unused entries are zero.
  struct gt_axis_state axes[GT_MAX_AXES];
} gt_state;

// Outputs of one tick.
typedef struct gt_tick_output {
  // Not 0: write `motors` to the drives. 0: the values in force at the drives are unknown, so
  // nothing may be written.
  uint8_t write;
  // Number of motors.
  uint32_t motor_count;
  // References of every motor; unused entries are zero, all of them if `write` is 0.
  struct gt_reference motors[GT_MAX_MOTORS];
  // Hellos refused in this tick.
  uint32_t refused;
  // Not 0: a session was granted in this tick.
  uint8_t welcomed;
  // Not 0: `owner` has a session, or still receives States after its end.
  uint8_t has_owner;
  // Connection of the owner.
  uint64_t owner;
  // Cause of an end of a session, or of a stop, in this tick; GT_CAUSE_NONE without one.
  gt_cause ended;
  // Not 0: a stop is latched, by other than `quit`, and not re-armed. Store it before the motors
  // are written; it is the `stop_latched` of the next start, in this process or a later one.
  uint8_t latched;
  // State after the tick, as it is sent if the drives take the references.
  struct gt_state state;
} gt_tick_output;

// References of a cycle in which no tick is run.
typedef struct gt_held {
  // Not 0: write `motors` to the drives. 0: nothing may be written.
  uint8_t write;
  // Not 0: `motors` are on the nominal references of this cycle; 0: on those of the last tick.
  uint8_t follows;
  // Number of motors.
  uint32_t motor_count;
  // References of every motor; unused entries are zero, all of them if `write` is 0.
  struct gt_reference motors[GT_MAX_MOTORS];
} gt_held;

// Contents of a black box.
typedef struct gt_black_box {
  // Ticks recorded, at most 3 GT_BLACK_BOX_TICKS.
  uint32_t ticks;
  // Parts of its file; 0 while no tick is recorded.
  uint32_t parts;
  // Not 0: the end of a session has frozen it, GT_BLACK_BOX_TICKS ticks ago. It records again
  // after gt_server_black_box_release.
  uint8_t frozen;
} gt_black_box;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns GT_ABI_VERSION of the linked library. Compare it with the header's before any other
// call.
uint32_t gt_abi_version(void);

// Returns the version of the library, such as "0.1.0": a static string, not to be freed.
const char *gt_version(void);

// Returns the name of a code, such as "GT_CODE_NULL_POINTER", or "GT_CODE_UNKNOWN": a static
// string, not to be freed.
const char *gt_code_name(int32_t code);

// Makes a compensator of a machine in `memory`. The machine is copied.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_COMPENSATOR_SIZE bytes. `compensator`:
// receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
gt_code gt_l2_compensator_init(void *memory,
                               size_t size,
                               const struct gt_l2 *machine,
                               const struct gt_compensator_config *config,
                               struct gt_l2_compensator **compensator,
                               struct gt_error *error);

// One cycle: offsets that hold the tool where the nominal positions put it, under `load`; to first
// order, at constant cost. For any load the result is within the limits, or an error.
//
// Errors: KINEMATICS_: as gt_l2_forward and gt_l2_inverse.
//
gt_code gt_l2_correction(const struct gt_l2_compensator *compensator,
                         const int64_t nominal_nm[3],
                         const struct gt_wrench *load,
                         struct gt_correction *correction,
                         struct gt_error *error);

// As gt_l2_correction, by the exact map, for large deflections with rotation of the platform. At
// most 10 rounds, each with two solves of six equations.
//
// Errors: KINEMATICS_: as gt_l2_forward; SINGULAR, NOT_CONVERGED, NOT_FINITE.
//
gt_code gt_l2_exact_correction(const struct gt_l2_compensator *compensator,
                               const int64_t nominal_nm[3],
                               const struct gt_wrench *load,
                               struct gt_correction *correction,
                               struct gt_error *error);

// Makes a compensator of a machine in `memory`. The machine is copied.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_COMPENSATOR_SIZE bytes. `compensator`:
// receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
gt_code gt_f1_compensator_init(void *memory,
                               size_t size,
                               const struct gt_f1 *machine,
                               const struct gt_compensator_config *config,
                               struct gt_f1_compensator **compensator,
                               struct gt_error *error);

// One cycle: offsets that hold the pose of the nominal positions under `load`; to first order. The
// pose is found by `tracker`, which is one of the same machine. For any load the result is within
// the limits, or an error.
//
// Errors: KINEMATICS_: as gt_f1_tracker_pose and gt_f1_inverse. After an error of the correction
// itself the tracker has the pose found; after one of the tracking it is as after
// gt_f1_tracker_pose.
//
gt_code gt_f1_correction(const struct gt_f1_compensator *compensator,
                         struct gt_f1_tracker *tracker,
                         const int64_t nominal_nm[6],
                         const struct gt_wrench *load,
                         struct gt_correction *correction,
                         struct gt_error *error);

// As gt_f1_correction, by the exact map: at most 10 inverses.
//
// Errors: as gt_f1_correction.
//
gt_code gt_f1_exact_correction(const struct gt_f1_compensator *compensator,
                               struct gt_f1_tracker *tracker,
                               const int64_t nominal_nm[6],
                               const struct gt_wrench *load,
                               struct gt_correction *correction,
                               struct gt_error *error);

// Copies a server with its session, connections and black box: a saved state. To restore it, copy
// it back to where the first one is, or go on with the copy. Both have the same epochs and keys, so
// one machine must never be led by both.
//
// `memory`, `size`: aligned to GT_ALIGN, at least as many bytes as gt_server_config_check has
// returned, apart from the server. `copy`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
gt_code gt_server_copy(const struct gt_server *server,
                       void *memory,
                       size_t size,
                       struct gt_server **copy,
                       struct gt_error *error);

// Copies a sensor with its tare and its filter; as gt_server_copy.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_SENSOR_SIZE bytes, apart from the sensor.
// `copy`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
gt_code gt_sensor_copy(const struct gt_sensor *sensor,
                       void *memory,
                       size_t size,
                       struct gt_sensor **copy,
                       struct gt_error *error);

// Copies a tracker with its last pose; as gt_server_copy.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_TRACKER_SIZE bytes, apart from the tracker.
// `copy`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_OVERLAP.
gt_code gt_f1_tracker_copy(const struct gt_f1_tracker *tracker,
                           void *memory,
                           size_t size,
                           struct gt_f1_tracker **copy,
                           struct gt_error *error);

// Makes a machine in `memory`: checks every number, once.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_SIZE bytes. `machine`: receives the
// handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (indices 3 and 4: turn_signs), those of ROBOT_:
// the first found.
gt_code gt_f1_init(void *memory,
                   size_t size,
                   const struct gt_f1_geometry *geometry,
                   struct gt_f1 **machine,
                   struct gt_error *error);

// Returns the CRC-32 over the kinematic parameters, as gt_l2_checksum.
gt_code gt_f1_checksum(const struct gt_f1 *machine, uint32_t *checksum);

// Inverse kinematics: positions (nm, rounded) for a pose. `near_nm`: positions from which the
// search starts, such as those of the last cycle; null: plates at 0. `solved` may be null.
// Bounded: at most 10 linear solves of each cluster, fewer from near positions.
//
// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, NOT_CONVERGED, OUT_OF_RANGE, OTHER_BRANCH,
// NOT_FINITE; CROSSING_OUT_OF_RANGE: a position of 2^53 nm or more. `positions_nm` is then not
// written.
//
gt_code gt_f1_inverse(const struct gt_f1 *machine,
                      const struct gt_pose *pose,
                      const int64_t near_nm[6],
                      int64_t positions_nm[6],
                      struct gt_solved *solved,
                      struct gt_error *error);

// The Jacobian: the platform's twist (translation over rotation, world axes) per axis, 36 numbers
// row by row; m and rad per q-unit. `pose` and positions_nm belong together (gt_f1_inverse,
// gt_f1_tracker_pose); that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_f1_jacobian(const struct gt_f1 *machine,
                       const struct gt_pose *pose,
                       const int64_t positions_nm[6],
                       double jacobian[36],
                       struct gt_error *error);

// Statics: tensions of the links (N, link order) and loads on the axes (N times m per q-unit, N m
// for plates; positive along +q). `pose` and positions_nm belong together; that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_f1_statics(const struct gt_f1 *machine,
                      const struct gt_pose *pose,
                      const int64_t positions_nm[6],
                      const struct gt_wrench *load,
                      double link_forces_n[6],
                      double axis_loads[6],
                      struct gt_error *error);

// Makes a tracker of a machine in `memory`, without a last pose. The machine is copied.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_TRACKER_SIZE bytes. `tracker`: receives
// the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL.
gt_code gt_f1_tracker_init(void *memory,
                           size_t size,
                           const struct gt_f1 *machine,
                           struct gt_f1_tracker **tracker,
                           struct gt_error *error);

// Forward kinematics: the pose for positions in nm, found from the tracker's last pose by at most
// 2 linear solves, enough at 1 m/s and 1 kHz. One attempt per call: after an error, where the last
// pose stays, the next call makes up to 10 solves from it, the one after that up to 10 from the
// synchronised form, and so in turn until one succeeds. `solved` may be null.
//
// Errors: KINEMATICS_: NO_ASSEMBLY, NOT_CONVERGED, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH,
// NOT_FINITE; SEED_REQUIRED: the machine has no synchronised form, so gt_f1_tracker_start_from
// must be called first.
//
gt_code gt_f1_tracker_pose(struct gt_f1_tracker *tracker,
                           const int64_t positions_nm[6],
                           struct gt_pose *pose,
                           struct gt_solved *solved,
                           struct gt_error *error);

// Takes a pose as the last one; null: forgets the last one, and the next pose is found from the
// synchronised form. The pose is not checked: from one that is not finite or far away the next
// calls are errors.
gt_code gt_f1_tracker_start_from(struct gt_f1_tracker *tracker, const struct gt_pose *pose);

// Makes a machine in `memory`: checks every number and the Tau property, once.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_SIZE bytes. `machine`: receives the
// handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (index 3: forward_branch), those of ROBOT_ and
// ORIENTATION_: the first found.
gt_code gt_l2_init(void *memory,
                   size_t size,
                   const struct gt_l2_geometry *geometry,
                   struct gt_l2 **machine,
                   struct gt_error *error);

// Returns the CRC-32 over the kinematic parameters, metres_per_q included (wire.md), for
// kinematics_checksum of a server; the client compares it with its own.
gt_code gt_l2_checksum(const struct gt_l2 *machine, uint32_t *checksum);

// Inverse kinematics: positions (nm, rounded) that put the tool centre point at tcp_m (world axes,
// m), for a tool on the machine's side of the carts' plane. Closed form, constant cost.
//
// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE;
// CROSSING_OUT_OF_RANGE: a position of 2^53 nm or more. `positions_nm` is then not written.
//
gt_code gt_l2_inverse(const struct gt_l2 *machine,
                      const double tcp_m[3],
                      int64_t positions_nm[3],
                      struct gt_error *error);

// Forward kinematics: position of the tool centre point (world axes, m) for positions in nm.
// Closed form, constant cost.
//
// Errors: KINEMATICS_: NO_ASSEMBLY, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH.
//
gt_code gt_l2_forward(const struct gt_l2 *machine,
                      const int64_t positions_nm[3],
                      double tcp_m[3],
                      struct gt_error *error);

// The Jacobian dT/dq at tcp_m, 9 numbers row by row: m per q-unit, world axes.
//
// Errors: as gt_l2_inverse.
//
gt_code gt_l2_jacobian(const struct gt_l2 *machine, const double tcp_m[3], double jacobian[9], struct gt_error *error);

// Statics: tensions of the links (N, link order) and loads on the carts (N times m per q-unit,
// positive along +q), under a load. tcp_m and positions_nm belong together (gt_l2_inverse,
// gt_l2_forward); that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_l2_statics(const struct gt_l2 *machine,
                      const double tcp_m[3],
                      const int64_t positions_nm[3],
                      const struct gt_wrench *load,
                      double link_forces_n[6],
                      double cart_loads[3],
                      struct gt_error *error);

// Converts a length to whole nanometres, rounded half away from zero. The only conversion from
// floats to references.
//
// Errors: those of CROSSING_ (NaN, infinite, or 2^53 nm and more).
gt_code gt_position_from_metres(double metres, int64_t *position_nm, struct gt_error *error);

// Makes a sensor in `memory`; it starts with its tare.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_SENSOR_SIZE bytes. `sensor`: receives the
// handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_SENSOR_NOT_ROTATION, GT_CODE_SENSOR_OUT_OF_RANGE: the
// first found.
gt_code gt_sensor_init(void *memory,
                       size_t size,
                       const struct gt_sensor_config *config,
                       struct gt_sensor **sensor,
                       struct gt_error *error);

// Moves the notches behind a low-pass of second order, within 50 cycles, or at once while it is
// tared. A machine swings least with them at its natural frequencies where it is.
//
// `hz`: three frequencies, 1e-3 to 0.45 / cycle_s; 0: no notch. Each has its place: a notch that
// moves stays where it is among them. `q`: of all three, 0.1 to 10; 0.7 is wide enough for
// frequencies that are 20 % wrong.
//
// Errors: GT_CODE_SENSOR_OUT_OF_RANGE, also for a notch behind a low-pass of first order; the
// sensor is then unchanged.
//
gt_code gt_sensor_set_notches(struct gt_sensor *sensor, const double hz[3], double q, struct gt_error *error);

// Takes one raw sample (sensor axes, about the sensor's origin), once per cycle, with the platform
// in `pose`, of which only the rotation is read: of an L2 it is constant, of an F1 see
// gt_f1_tracker_pose. `taring` receives the samples that the tare still needs; when it is 0,
// `load` receives the load on the platform, world axes, about the tool centre point, filtered,
// otherwise zeros. Constant cost.
//
// Errors: GT_CODE_SENSOR_BAD_READING, GT_CODE_SENSOR_PLATFORM_NOT_ROTATION; the sensor is then
// unchanged.
gt_code gt_sensor_update(struct gt_sensor *sensor,
                         const struct gt_wrench *raw,
                         const struct gt_pose *pose,
                         struct gt_wrench *load,
                         uint32_t *taring);

// Starts again with the tare, the filter at zero. The tool must be unloaded.
gt_code gt_sensor_restart(struct gt_sensor *sensor);

// Fills a configuration with the profile of the thesis: 1 kHz, one lost Command tolerated,
// position offsets of at most 2 mm that change by at most 5 um per tick and go back to zero by 0.1
// um per tick, no velocity or torque offsets, one motor per axis, no black box. Travel and
// nominal_step_nm are 0 and must be set: no machine is assumed. `axes`: 3 or 6.
//
// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_CONFIG_AXES.
gt_code gt_server_config_thesis(struct gt_server_config *config, uint32_t axes);

// Checks a configuration, and returns the bytes that its server needs on this target, at most
// GT_SERVER_SIZE_6_BLACK_BOX. `size` may be null.
//
// Errors: GT_CODE_BLACK_BOX, GT_CODE_MOTOR_COUNT, those of LIMITS_, CONFIG_ and MOTOR_MAP: the
// first found.
gt_code gt_server_config_check(const struct gt_server_config *config, size_t *size, struct gt_error *error);

// Creates a server in `memory`, without connections. Offsets in force start in
// GT_PHASE_SAFE_DISCONNECT, a latched stop in GT_PHASE_FAULT. Nothing is to be freed: memory of a
// server that is no longer used can be used again.
//
// `memory`, `size`: aligned to GT_ALIGN (GT_MEMORY, malloc), at least GT_SERVER_SIZE_... bytes;
// its contents are overwritten. `server`: receives the handle, which points into `memory`.
//
// Errors: those of gt_server_config_check; GT_CODE_MEMORY_TOO_SMALL, GT_CODE_MISALIGNED,
// GT_CODE_START_OFFSET_IN_FORCE. After an error do not use a server that was in the memory before.
gt_code gt_server_init(void *memory,
                       size_t size,
                       const struct gt_server_config *config,
                       const struct gt_start *start,
                       struct gt_server **server,
                       struct gt_error *error);

// As gt_server_init, for a server that holders of these keys only are heard by: every frame has a
// tag. Over datagrams a peer without a connection is heard by gt_server_greet.
//
// Errors: as gt_server_init; GT_CODE_KEY_COUNT, GT_CODE_KEY_ROLE, GT_CODE_KEY_TWICE.
gt_code gt_server_init_keyed(void *memory,
                             size_t size,
                             const struct gt_server_config *config,
                             const struct gt_start *start,
                             const struct gt_keys *keys,
                             struct gt_server **server,
                             struct gt_error *error);

// Takes a datagram of a peer without a connection. Only a Hello gets it one; of a server with keys
// only a Hello with a right tag, from a peer that has shown that it hears. Datagrams of a peer with
// a connection go to gt_server_feed.
//
// `peer`: GT_PEER bytes of its address and port; `greeting` receives what to do.
gt_code gt_server_greet(struct gt_server *server,
                        const uint8_t *peer,
                        const uint8_t *datagram,
                        size_t length,
                        struct gt_greeting *greeting);

// `id` receives the GT_KEY_ID bytes of the name of the session's key, for the log. GT_CODE_DONE:
// there is no session, or there are no keys.
gt_code gt_server_granted_key(struct gt_server *server, uint8_t *id);

// Registers a connection that the caller has accepted. `transport`: GT_TRANSPORT_STREAM or
// GT_TRANSPORT_DATAGRAM. `connection` receives its number, which is never given twice.
//
// Errors: GT_CODE_TRANSPORT; GT_CODE_FULL: GT_MAX_CONNECTIONS are open, send gt_server_refusal and
// close.
gt_code gt_server_open(struct gt_server *server, uint32_t transport, uint64_t *connection);

// `connection` receives the one that is to make room for a new stream after GT_CODE_FULL: send it
// the frame of gt_server_refusal, close it, and open the new one. GT_CODE_DONE: there is none, and
// the new one is refused.
gt_code gt_server_longest_idle(struct gt_server *server, uint64_t *connection);

// Returns the frame for a peer without room for its connection; the frame's `connection` has no
// meaning. `transport`: as for gt_server_open.
//
// Errors: GT_CODE_TRANSPORT.
gt_code gt_server_refusal(uint32_t transport, struct gt_frame *frame);

// Takes note that a connection is gone: closed by its peer, reset, or because a frame could not be
// written to it whole. A connection that is not open is ignored.
gt_code gt_server_close(struct gt_server *server, uint64_t connection);

// Takes bytes that were read from a connection: for a stream any piece of it, for datagrams
// exactly one. The work is bounded by `length`. Frames beyond a connection's budget per tick are
// not read (8 of the owner: a ninth ends the session; 1 of others: they are closed). A connection
// that is not open is ignored.
//
// `frames` receives the number of frames of this connection in the coming tick; it may be null.
gt_code gt_server_feed(struct gt_server *server,
                       uint64_t connection,
                       const uint8_t *bytes,
                       size_t length,
                       uint8_t *frames);

// Lock-step: `answered` receives 1 if the coming tick has what it waits for (a Command that
// answers the last State, or an event of the owner that ends the session), else 0.
gt_code gt_server_owner_has_answered(struct gt_server *server, uint8_t *answered);

// Replaces the epochs that may be granted: a further range, reserved in storage. An epoch is never
// granted twice.
gt_code gt_server_set_epochs(struct gt_server *server, uint64_t first, uint64_t last);

// Runs one cycle on everything that was fed since the last tick. Its work is bounded for
// any input: no allocation, no lock, no clock.
//
// Call it once per cycle; then write `output->motors` to the drives if `output->write` is not 0, and
// tell gt_server_written what became of them; then send what gt_server_poll_transmit returns; then
// close what gt_server_poll_close returns.
// Drives need a watchdog for the case that no tick comes.
//
// The first tick needs a reading, and compares it: GT_CODE_START_DISAGREES if a drive does not
// stand at what gt_start says is in force.
//
// Errors: GT_CODE_TICK_INPUT: reading, stop or rearm, in this order, is not one of its values, and
// `error` says which; GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
// After an error nothing has changed.
gt_code gt_server_tick(struct gt_server *server,
                       const struct gt_tick_input *input,
                       struct gt_tick_output *output,
                       struct gt_error *error);

// Returns the references of a cycle in which no tick is run, for a thread that calls in a burst
// after a delay: the offsets of the last tick on the nominal references of this cycle, within the
// machine's travel. If one of them is further from that of the last tick than its limit in
// `elapsed_cycles` cycles, all of them stay. Nothing changes: the next tick counts the cycle in
// its own `elapsed_cycles`.
//
// Of `input`, `elapsed_cycles` and `nominal_nm` are read.
//
// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
gt_code gt_server_hold(struct gt_server *server,
                       const struct gt_tick_input *input,
                       struct gt_held *output,
                       struct gt_error *error);

// Takes note of what became of the references of the last tick: GT_WRITE_ACCEPTED,
// GT_WRITE_REFUSED, which stops, with the values in force at the drives, or GT_WRITE_UNKNOWN, which
// stops. Call it once after every tick, before gt_server_poll_transmit: its State reports the values
// in force, and the next tick goes on from them. Not called: unknown.
//
// After a tick with `write` 0: GT_WRITE_REFUSED with the values that were read back, or
// GT_WRITE_UNKNOWN. `in_force`: as many values as there are axes; read for GT_WRITE_REFUSED only, else
// null is allowed.
//
// Errors: GT_CODE_NOT_PENDING, GT_CODE_WITHHELD, GT_CODE_WRITE; GT_CODE_NULL_POINTER,
// GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT. But for GT_CODE_WITHHELD nothing has changed.
gt_code gt_server_written(struct gt_server *server, uint8_t fate, const struct gt_in_force *in_force);

// Takes note of the time from the departure of the last State to the arrival of the last Command, us.
// It is recorded, and reported by the State of the coming tick; without a call it is 0.
gt_code gt_server_note_arrival(struct gt_server *server, uint16_t us);

// `at_zero` receives 1 if the drives took references without offsets in the last tick, so that the
// program may end; else 0. After a refused write it is 0 for any values in force before: the drives
// may have taken a part of it.
gt_code gt_server_is_at_zero(struct gt_server *server, uint8_t *at_zero);

// Returns the next frame of the last tick, in the order in which they are to be sent: Refusals,
// the Welcome, the State. Frames that are not polled before the next tick are discarded.
//
// Errors: GT_CODE_DONE after the last one.
gt_code gt_server_poll_transmit(struct gt_server *server, struct gt_frame *frame);

// Returns the next connection to close, after its frames are sent. Poll the frames first. A
// connection that is not polled keeps its place among GT_MAX_CONNECTIONS.
//
// Errors: GT_CODE_DONE after the last one.
gt_code gt_server_poll_close(struct gt_server *server, uint64_t *connection);

// Returns the contents of the black box. Without one: 0 ticks, never frozen.
gt_code gt_server_black_box(struct gt_server *server, struct gt_black_box *black_box);

// Writes part `index` of the black box as a file, 0 to `parts` - 1 of gt_black_box. All parts in
// order are a file that `gantry-tau replay` runs again, bit for bit. A frozen box does not change,
// so a program can write a part per cycle; a box that still records is to be read as a whole
// between two ticks.
//
// `buffer`, `size`: initialised memory, GT_BLACK_BOX_PART bytes at most; null with size 0 to ask
// for the length. `length`: receives the length of the part, whether it fits or not.
//
// Errors: GT_CODE_INDEX; GT_CODE_BUFFER_TOO_SMALL: the buffer has the beginning of the part.
gt_code gt_server_black_box_part(struct gt_server *server,
                                 uint32_t index,
                                 uint8_t *buffer,
                                 size_t size,
                                 size_t *length);

// Clears the black box and records again: after its parts are written, and when a new session was
// granted.
gt_code gt_server_black_box_release(struct gt_server *server);

// Reads the text of a key file, which `gantry-tau key new` makes. A reader of the file can move the
// machine: check its permissions before.
//
// Errors: GT_CODE_KEY_TEXT.
gt_code gt_key_parse(const uint8_t *text, size_t length, struct gt_key *key, struct gt_error *error);

// `id` receives the GT_KEY_ID bytes of the name of a key, which says nothing of its secret.
//
// Errors: GT_CODE_KEY_ROLE.
gt_code gt_key_id(const struct gt_key *key, uint8_t *id);

// Rounds a raw sample of a force sensor (sensor axes, about its origin) to the nearest mN and uN m.
// A component beyond 2^31 - 1 of them is cut, and `status` says so; with a NaN there is no sample.
gt_code gt_wrench_sample_of(const struct gt_wrench *raw, uint8_t age, struct gt_wrench_sample *sample);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GANTRY_TAU_H */
