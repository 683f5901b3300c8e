/*
 * The component of the L2 with a clock that the test moves, a LinuxCNC of a few lines, drives that follow at once, and a client in the place of the
 * sockets: `bench CASE EPOCHS`. Exit code 0: every requirement held.
 */
#include "hal_stub.h"

#include "gantry_tau.c"
#include "units.h"
#include "wire.h"

enum { PERIOD = 1000000, AXES = GANTRY_TAU_AXES };

/* The client: it answers every State at once while `answers`, with `target_nm` for every axis. */
static struct {
    int is_present, answers, says_hello;
    uint64_t connection, sequence, epoch, tick;
    uint8_t mode;
    int32_t target_nm;
    wire_frame waiting;
} client;

int sockets_open(const char *address, int port, int udp, char *error, size_t size)
{
    (void)address, (void)port, (void)udp, (void)error, (void)size;
    return 0;
}
void sockets_shut(void) {}
void sockets_close(uint64_t connection) { client.is_present &= connection != client.connection; }
void sockets_wait(uint64_t connection, long timeout_ns) { (void)connection, (void)timeout_ns; }

void sockets_receive(gt_server *to)
{
    if (client.says_hello) {
        client.says_hello = 0;
        REQUIRE(gt_server_open(to, GT_TRANSPORT_STREAM, &client.connection) == GT_CODE_OK);
        client.is_present = 1;
        wire_hello(&client.waiting, AXES);
    }
    if (client.is_present && client.waiting.length > 0) {
        gt_server_feed(to, client.connection, client.waiting.bytes, client.waiting.length, NULL);
        client.waiting.length = 0;
    }
}

void sockets_send(const gt_frame *sent)
{
    if (sent->bytes[3] == WELCOME) {
        client.epoch = wire_get(sent->bytes + WIRE_HEADER, 8);
    } else if (sent->bytes[3] == STATE && client.answers) {
        const int32_t targets[AXES] = {client.target_nm, -client.target_nm, client.target_nm};
        client.tick = wire_get(sent->bytes + WIRE_HEADER, 8);
        wire_command(&client.waiting, client.epoch, ++client.sequence, client.tick, client.mode, AXES, targets);
    }
}

/* The machine: signals, and which of them reach which pin. */
static struct {
    hal_float_t command[AXES], drive[AXES];
    hal_bit_t enable, permit;
    double speed; /* mm per period, of each joint while the machine is on */
    int wants_on, reads, is_permit_ignored;
    double pushed; /* mm per period, while off */
    int feedback_of[AXES]; /* joint whose feedback each joint of LinuxCNC gets */
} machine = {.reads = 1, .feedback_of = {0, 1, 2}};

static const double HOME[AXES] = {624.4998, -696.419414, 668.954408};

/* Reference of a joint as core gave it out in the last call. */
static double given(int joint, int is_held)
{
    const gt_reference *motors = is_held ? held.motors : output.motors;
    for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
        if (gantry_tau_axis_of_motor[motor] == joint) {
            return gt_joint_of_nm(joint, motors[motor].position_nm);
        }
    }
    return 0;
}

/* One call of both functions, `apart_ns` after the last one. */
static void call(long long apart_ns)
{
    now_ns += apart_ns;
    for (int joint = 0; joint < AXES; joint++) {
        machine.drive[joint] = machine.enable ? *pins->joint[joint].reference : machine.drive[joint] + machine.pushed;
    }
    if (machine.reads) {
        read_function(NULL, PERIOD);
    }
    machine.enable = machine.wants_on && (machine.permit || machine.is_permit_ignored);
    for (int joint = 0; joint < AXES; joint++) {
        const double feedback = *pins->joint[machine.feedback_of[joint]].feedback;
        machine.command[joint] = machine.enable ? machine.command[joint] + machine.speed : feedback;
    }
    const hal_u32_t held_before = *pins->held;
    write_function(NULL, PERIOD);
    for (int joint = 0; joint < AXES && server != NULL; joint++) {
        /* Core's number, and no other. */
        const int is_held = *pins->held != held_before;
        const double reference = given(joint, is_held);
        const struct joint_pins *of = &pins->joint[joint];
        REQUIRE(*of->reference == reference);
        REQUIRE(*of->offset == gt_joint_of_nm(joint, output.state.axes[joint].offsets.position_nm));
        REQUIRE(*of->shadow == gt_joint_of_nm(joint, output.state.axes[joint].shadow.position_nm));
        for (int motor = 0; motor < GANTRY_TAU_MOTORS; motor++) {
            const gt_reference *core = is_held ? &held.motors[motor] : &output.motors[motor];
            const struct motor_pins *to = &pins->motor[motor];
            if (gantry_tau_axis_of_motor[motor] == joint) {
                REQUIRE(*to->reference == reference);
                REQUIRE(*to->velocity_offset == gt_joint_of_nm(joint, core->velocity_offset_um_s * INT64_C(1000)));
                REQUIRE(*to->torque_offset == core->torque_offset_permille);
                REQUIRE(*of->velocity_offset == *to->velocity_offset && *of->torque_offset == *to->torque_offset);
            }
        }
    }
}

static void calls(int number)
{
    for (int i = 0; i < number; i++) {
        call(PERIOD);
    }
}

/* The pins as they were made: not connected. */
static struct pins made;

/* Connects everything; the drives stand at home. */
static void wire(void)
{
    REQUIRE(rtapi_app_main() == 0);
    made = *pins;
    for (int joint = 0; joint < AXES; joint++) {
        pins->joint[joint].nominal = &machine.command[joint];
        pins->joint[joint].position = &machine.drive[joint];
        machine.drive[joint] = HOME[joint];
    }
    pins->enable = &machine.enable;
    pins->permit = &machine.permit;
}

/* Switches on and re-arms; a start is a stop. */
static void switch_on(void)
{
    calls(3);
    REQUIRE(machine.permit && *pins->phase == GT_PHASE_FAULT);
    machine.wants_on = 1;
    calls(2);
    *pins->rearm = 1;
    calls(2);
    *pins->rearm = 0;
    REQUIRE(machine.enable && *pins->phase == GT_PHASE_LISTENING);
}

/* A session in Obtain. */
static void obtain(int32_t target_nm)
{
    client.says_hello = client.answers = 1;
    client.mode = SUBMIT;
    calls(3);
    REQUIRE(*pins->phase == GT_PHASE_SUBMIT);
    client.mode = OBTAIN;
    client.target_nm = target_nm;
    calls(3);
    REQUIRE(*pins->phase == GT_PHASE_OBTAIN);
}

static int64_t offset(int joint) { return output.state.axes[joint].offsets.position_nm; }

/* Lines that were said. */
static int lines(void)
{
    int count = 0;
    for (const char *at = said; *at != 0; at++) {
        count += *at == '\n';
    }
    return count;
}

/* --- permit: each of its inputs wrong, missing, stale or swapped, one at a time --- */

static void swap(hal_float_t **one, hal_float_t **other)
{
    hal_float_t *was = *one;
    *one = *other;
    *other = was;
}
static hal_float_t elsewhere;

static void enable_missing(void) { pins->enable = made.enable; }
static void permit_missing(void) { pins->permit = made.permit; }
static void nominal_missing(void) { pins->joint[1].nominal = made.joint[1].nominal; }
static void position_missing(void) { pins->joint[2].position = made.joint[2].position; }
static void position_nan(void) { machine.drive[1] = NAN; }
static void velocity_nan(void) { *pins->joint[1].velocity = NAN; }
static void torque_infinite(void) { *pins->joint[1].torque = INFINITY; }
static void position_beyond(void) { machine.drive[0] = 3000.0; }
static void position_swapped(void) { swap(&pins->joint[0].position, &pins->joint[1].position); }
static void position_moves(void) { machine.pushed = 1.0; }
static void nominal_swapped(void) { swap(&pins->joint[0].nominal, &pins->joint[1].nominal); }
static void nominal_wrong(void) { elsewhere = HOME[2] - 0.0101, pins->joint[2].nominal = &elsewhere; }
static void nominal_nan(void) { elsewhere = NAN, pins->joint[0].nominal = &elsewhere; }
static void nominal_stale(void) { elsewhere = 0.0, pins->joint[2].nominal = &elsewhere; }
static void feedback_swapped(void) { machine.feedback_of[0] = 2, machine.feedback_of[2] = 0; }
static void read_missing(void) { machine.reads = 0; }

static const struct refusal {
    const char *name;
    void (*change)(void);
    const char *line;
} refusals[] = {
    {"enable missing", enable_missing, "gantry-tau.enable is not connected"},
    {"permit missing", permit_missing, "gantry-tau.permit is not connected"},
    {"nominal missing", nominal_missing, "gantry-tau.1.nominal is not connected"},
    {"position missing", position_missing, "gantry-tau.2.position is not connected"},
    {"position is NaN", position_nan, "not a number in range"},
    {"velocity is NaN", velocity_nan, "not a number in range"},
    {"torque is infinite", torque_infinite, "not a number in range"},
    {"position beyond the travel", position_beyond, "joint 0: gantry-tau.0.position is 3000.000000 mm, 990.000000 from the reference"},
    {"positions swapped", position_swapped, "joint 0: gantry-tau.0.position is -696.419414 mm, -186.419414 from the reference"},
    {"position moves", position_moves, "joint 0: gantry-tau.0.position is "},
    {"nominal swapped", nominal_swapped, "joint 0: gantry-tau.0.nominal is -696.419414 mm, -1320.919214 from the nominal position in force"},
    {"nominal 10.1 um off", nominal_wrong, "joint 2: gantry-tau.2.nominal is 668.944308 mm, -0.010100 from the nominal position in force"},
    {"nominal is NaN", nominal_nan, "joint 0: gantry-tau.0.nominal is nan mm"},
    {"nominal stale", nominal_stale, "joint 2: gantry-tau.2.nominal is 0.000000 mm, -668.954408 from the nominal position in force"},
    {"feedback swapped", feedback_swapped, "joint 0: gantry-tau.0.nominal is 668.954408 mm, 44.454608 from the nominal position in force"},
    {"read missing", read_missing, "gantry-tau.read does not run before every gantry-tau.write"},
};
enum { REFUSALS = sizeof refusals / sizeof *refusals };

/* Not permitted, one line, and a machine that is switched on all the same gets no step. */
static void refuses(const struct refusal *refusal)
{
    double before[AXES];
    hal_bit_t *permit;
    wire();
    refusal->change();
    permit = pins->permit;
    for (int i = 0; i < SAY_AFTER + 500; i++) {
        call(PERIOD);
        /* The first call of a moving drive sees it where it starts. */
        REQUIRE(!*permit || (machine.pushed > 0 && i == 0));
    }
    REQUIRE(strstr(said, refusal->line) != NULL);
    /* No force sensor is connected, which is said at the start. */
    REQUIRE(lines() == (server == NULL ? 1 : 2));
    machine.pushed = 0;
    for (int joint = 0; joint < AXES; joint++) {
        before[joint] = *pins->joint[joint].reference;
    }
    machine.wants_on = machine.is_permit_ignored = 1;
    calls(20);
    for (int joint = 0; joint < AXES; joint++) {
        /* What the approach to a drive by a 64th per period still does in the period before. */
        REQUIRE(fabs(*pins->joint[joint].reference - before[joint]) < 1.0);
    }
    REQUIRE(*pins->phase == GT_PHASE_FAULT);
}

/* An input that goes wrong after the machine was permitted takes the permit back at once, off and on. */
static void takes_back(void)
{
    wire();
    calls(3);
    REQUIRE(machine.permit);
    machine.reads = 0;
    calls(1);
    REQUIRE(!machine.permit);
    machine.reads = 1;
    calls(1);
    REQUIRE(machine.permit);
    elsewhere = HOME[0] + 0.0099;
    pins->joint[0].nominal = &elsewhere;
    calls(1);
    REQUIRE(machine.permit);
    elsewhere = HOME[0] + 0.0101;
    calls(1);
    REQUIRE(!machine.permit);
    pins->joint[0].nominal = &machine.command[0];
    switch_on();
    machine.speed = 0.1;
    calls(50);
    REQUIRE(machine.permit);
    machine.reads = 0;
    calls(1);
    REQUIRE(!machine.permit && *pins->phase == GT_PHASE_FAULT);
    REQUIRE(lines() == 1);
}

static void press(void) { *pins->stop = 1; }
static void switch_off(void) { machine.wants_on = 0; }
static void lose_drive(void) { pins->joint[1].position = &elsewhere, elsewhere = NAN; }
static void lose_read(void) { machine.reads = 0; }

/* A drive that is pushed while it is off is followed by a 64th of the distance per period, at most by the largest nominal step; LinuxCNC with it. */
static void follows_a_push(void)
{
    const double limit = gt_joint_of_nm(0, gantry_tau_limits[0].nominal_step_nm);
    double last;
    wire();
    calls(3);
    machine.drive[0] += 0.064;
    last = *pins->joint[0].reference;
    calls(1);
    REQUIRE(!machine.permit && fabs(*pins->joint[0].reference - last - 0.001) < 1e-6);
    calls(1);
    REQUIRE(fabs(machine.command[0] - *pins->joint[0].reference) < 1.1e-3);
    calls(1000);
    REQUIRE(machine.permit && fabs(*pins->joint[0].reference - machine.drive[0]) < 1e-6);
    last = *pins->joint[0].reference;
    machine.drive[0] -= 200.0;
    calls(1);
    REQUIRE(fabs(last - *pins->joint[0].reference - limit) < 1e-6);
    machine.drive[0] += 400.0;
    last = *pins->joint[0].reference;
    calls(1);
    REQUIRE(fabs(*pins->joint[0].reference - last - limit) < 1e-6);
    machine.drive[0] = last;
    calls(2000);
    switch_on();
}

/* Machine off with an offset in force: the reference stays at the drive while the offset ramps, and what is left becomes LinuxCNC's position. */
static void off_with_an_offset(void)
{
    double stood;
    wire();
    switch_on();
    obtain(500000);
    calls(200);
    REQUIRE(offset(0) == 500000);
    REQUIRE(*pins->joint[0].feedback == machine.drive[0] - gt_joint_of_nm(0, 500000));
    stood = machine.drive[0];
    machine.wants_on = 0;
    for (int i = 0; i < 6000; i++) {
        call(PERIOD);
        REQUIRE(machine.drive[0] == stood && fabs(*pins->joint[0].reference - stood) < 0.0101);
    }
    REQUIRE(offset(0) == 0 && machine.permit);
    REQUIRE(fabs(machine.command[0] - stood) < 1e-6 && fabs(*pins->joint[0].reference - stood) < 1e-6);
}

/* On at the start: the references begin where the drives are, and stay there unless LinuxCNC's command does too. */
static void on_at_the_start(void)
{
    wire();
    machine.wants_on = machine.is_permit_ignored = 1;
    calls(1);
    REQUIRE(*pins->phase == GT_PHASE_FAULT);
    for (int i = 0; i < 100; i++) {
        machine.command[0] = 100.0;
        call(PERIOD);
        REQUIRE(!machine.permit && fabs(*pins->joint[0].reference - HOME[0]) < 1e-6);
    }
}

/* A drive whose measurement is lost while it is off: the references stay, and go on when it is back. */
static void lost_while_off(void)
{
    double reference;
    wire();
    calls(5);
    reference = *pins->joint[1].reference;
    lose_drive();
    machine.drive[0] += 1.0; /* of all joints together: some of them could be a pose that the machine does not have */
    calls(5);
    REQUIRE(!machine.permit && *pins->joint[1].reference == reference && fabs(*pins->joint[0].reference - HOME[0]) < 1e-6);
    machine.drive[0] -= 1.0;
    pins->joint[1].position = &machine.drive[1];
    calls(5);
    REQUIRE(machine.permit && *pins->joint[1].reference == reference);
    /* On, then lost: the other joints stay as well. */
    switch_on();
    machine.speed = 0.1;
    calls(10);
    reference = *pins->joint[0].reference;
    *pins->joint[2].velocity = NAN;
    calls(5);
    REQUIRE(*pins->joint[0].reference == reference && !machine.permit && *pins->phase == GT_PHASE_FAULT);
}

/* A command that is lost while the machine is on. */
static void command_is_nan(void)
{
    double reference;
    wire();
    switch_on();
    machine.speed = 0.1;
    calls(10);
    reference = *pins->joint[1].reference;
    elsewhere = NAN;
    pins->joint[0].nominal = &elsewhere;
    calls(1);
    REQUIRE(!machine.permit && *pins->phase == GT_PHASE_FAULT && *pins->joint[1].reference == reference);
}

/* What the drives measure is what the client is sent. */
static void measures(void)
{
    wire();
    *pins->joint[1].velocity = 12.0;
    *pins->joint[1].torque = -34.0;
    calls(3);
    REQUIRE(output.state.axes[1].actual.velocity_um_s == 12000 && output.state.axes[1].actual.torque_permille == -34);
    REQUIRE(output.state.axes[1].actual.position_nm == -696419414);
    *pins->joint[1].velocity = 3e6; /* beyond 32 bits */
    calls(1);
    REQUIRE(!machine.permit);
}

/* Calls that come too early are no burst, nor is one that is late once. */
static void jitter(void)
{
    wire();
    switch_on();
    obtain(100000);
    for (int i = 0; i < 3000; i++) {
        call(i % 2 ? PERIOD + 400000 : PERIOD - 400000);
        call(PERIOD - 5000);
        REQUIRE(*pins->lateness >= 0);
    }
    REQUIRE(*pins->held == 0 && *pins->phase == GT_PHASE_OBTAIN);
    /* Ahead of its clock for a while: the anchor has moved with it, so that the next delay is seen at once. */
    call(PERIOD + PERIOD + 1000);
    REQUIRE(*pins->held == 1);
}

/* A thread whose clock is slow by less than a thousandth is followed without a single re-anchoring. */
static void slow_clock(void)
{
    wire();
    switch_on();
    for (int i = 0; i < 5000; i++) {
        call(PERIOD + 900);
        REQUIRE(*pins->lateness <= 1000);
    }
}

/* A thread whose clock is moved back by 4 us in every period for 3 s ticks in every call; stop and machine-off are seen in theirs. */
static void thread_moved_back(void)
{
    wire();
    switch_on();
    obtain(100000);
    for (int i = 0; i < 3000; i++) {
        client.target_nm = i / 500 % 2 ? 100000 : -900000;
        call(PERIOD + 4000 + (i % 2 ? 50000 : -50000));
        REQUIRE(*pins->phase == GT_PHASE_OBTAIN && machine.permit);
    }
    REQUIRE(*pins->held == 0 && *pins->missed == 0);
    *pins->stop = 1;
    call(PERIOD + 4000);
    REQUIRE(*pins->phase == GT_PHASE_FAULT);
    for (int64_t left = llabs(offset(0)); left > 0; left -= 100) {
        REQUIRE(llabs(offset(0)) <= left);
        call(PERIOD + 4000);
    }
    REQUIRE(offset(0) == 0 && *pins->held == 0);
}

/* A thread that skips the periods it missed, as later versions of LinuxCNC do: anchored again after a few calls. */
static void thread_skips(void)
{
    wire();
    switch_on();
    obtain(100000);
    call(50 * PERIOD);
    REQUIRE(*pins->held == 1);
    calls(1);
    REQUIRE(*pins->held == 2);
    calls(1);
    REQUIRE(*pins->held == 2 && *pins->phase == GT_PHASE_SAFE_DISCONNECT && *pins->cause == GT_CAUSE_SERVER_LATE);
    calls(2000);
    REQUIRE(*pins->held == 2 && offset(0) == 0);
    /* A call of a burst begins the row anew. */
    call(10 * PERIOD);
    call(16000);
    calls(2);
    REQUIRE(*pins->held == 6);
    calls(1);
    REQUIRE(*pins->held == 6);
    /* Too slow a computer: every call comes late, none in a burst. */
    for (int i = 0; i < 1000; i++) {
        call(PERIOD + 600000);
    }
    REQUIRE(*pins->held <= 9);
}

/* The thread stands for `periods`, and catches up in a burst. Returns calls of the burst so far. */
static void stand(int periods) { call(periods * (long long)PERIOD); }

/* In a burst the offset stays, on the path, until a stop. */
static void burst_holds(void)
{
    double nominal_before, reference_before;
    wire();
    switch_on();
    obtain(500000);
    machine.speed = 0.1;
    calls(40);
    nominal_before = machine.command[0];
    reference_before = *pins->joint[0].reference;
    stand(50);
    for (int i = 0; i < 40; i++) {
        const double moved = machine.command[0] - nominal_before;
        REQUIRE(fabs(*pins->joint[0].reference - reference_before - moved) < 2e-6);
        REQUIRE((int)*pins->held == i + 1 && *pins->phase == GT_PHASE_OBTAIN);
        call(16000);
    }
}

/* What stops is seen in the call of a burst in which it comes, by one tick, and the rest of the burst is held. */
static void stops_in_a_burst(void (*stop)(void), double follows)
{
    int64_t before;
    double reference;
    hal_u32_t ticks;
    wire();
    switch_on();
    obtain(500000);
    machine.speed = 0.1;
    calls(40);
    stand(50);
    for (int i = 0; i < 10; i++) {
        call(16000);
    }
    REQUIRE(*pins->held == 11 && *pins->phase == GT_PHASE_OBTAIN);
    before = offset(0);
    ticks = *pins->tick;
    reference = *pins->joint[0].reference;
    stop();
    call(16000);
    REQUIRE(*pins->phase == GT_PHASE_FAULT && *pins->tick == ticks + 12);
    REQUIRE(machine.permit == (*pins->stop || !machine.wants_on));
    for (int i = 0; i < 20; i++) {
        REQUIRE(offset(0) == before - 100 && *pins->tick == ticks + 12);
        REQUIRE(fabs(*pins->joint[0].reference - reference) <= follows * (i + 1) + 2e-4);
        call(16000);
    }
    machine.speed = 0.0;
    calls(100);
    REQUIRE(offset(0) < before - 100 * 90);
}

static void stop_in_a_burst(void) { stops_in_a_burst(press, 0.1); }
static void off_in_a_burst(void) { stops_in_a_burst(switch_off, 0.1); }
static void lost_drive_in_a_burst(void) { stops_in_a_burst(lose_drive, 0.0); }
static void lost_read_in_a_burst(void) { stops_in_a_burst(lose_read, 0.0); }

/* A path that jumps in a burst is not followed, nor a drive's travel left. */
static void burst_is_bounded(void)
{
    double reference;
    wire();
    switch_on();
    calls(5);
    stand(20);
    call(16000);
    reference = *pins->joint[0].reference;
    machine.command[0] += 900.0;
    call(16000);
    REQUIRE(*pins->held == 3 && *pins->joint[0].reference == reference);
    /* Off in that call: the references stay with the drives, and do not go where the path has jumped to. */
    machine.wants_on = 0;
    machine.drive[0] = reference;
    call(16000);
    REQUIRE(fabs(*pins->joint[0].reference - reference) < 0.01);
}

/* Lateness beyond its bound is Fault, in the first call after it. */
static void too_late(void)
{
    wire();
    switch_on();
    obtain(100000);
    stand(251);
    REQUIRE(*pins->phase == GT_PHASE_OBTAIN && *pins->held == 1 && lines() == 1);
    REQUIRE(*pins->lateness_max == 250 * PERIOD);
    for (int i = 0; i < 500; i++) {
        call(16000);
    }
    REQUIRE(*pins->cause == GT_CAUSE_SERVER_LATE && *pins->phase != GT_PHASE_FAULT);
    calls(2000);
    obtain(100000);
    call(251 * (long long)PERIOD + 1);
    REQUIRE(*pins->phase == GT_PHASE_FAULT && *pins->cause == GT_CAUSE_STOP);
    REQUIRE(strstr(said, "the thread was late by more than 250 periods: stopped") != NULL);
}

/* A drive beyond the travel: core's reference ends there, and the component writes that. (`call` compares.) */
static void clamped(void)
{
    const double upper = gt_joint_of_nm(0, gantry_tau_limits[0].machine_upper_nm);
    wire();
    machine.drive[0] = upper + 5.0;
    calls(100);
    REQUIRE(*pins->joint[0].reference == upper);
}

/* Without an offset a reference is LinuxCNC's command in whole nanometres; the feedback is the drive's, bit for bit. */
static void rounds(void)
{
    wire();
    switch_on();
    machine.speed = 1e-3 / 3;
    for (int i = 0; i < 500; i++) {
        call(PERIOD);
        for (int joint = 0; joint < AXES; joint++) {
            REQUIRE(fabs(*pins->joint[joint].reference - machine.command[joint]) <= 0.51e-6);
            REQUIRE(*pins->joint[joint].feedback == machine.drive[joint]);
        }
    }
}

static const struct {
    const char *name;
    void (*run)(void);
} cases[] = {
    {"permit is taken back", takes_back},       {"thread moved back", thread_moved_back},
    {"thread skips", thread_skips},             {"burst holds", burst_holds},
    {"stop in a burst", stop_in_a_burst},       {"machine off in a burst", off_in_a_burst},
    {"lost drive in a burst", lost_drive_in_a_burst}, {"lost read in a burst", lost_read_in_a_burst},
    {"burst is bounded", burst_is_bounded},     {"too late", too_late},
    {"clamped", clamped},                       {"rounds", rounds},
    {"follows a push", follows_a_push},         {"off with an offset", off_with_an_offset},
    {"on at the start", on_at_the_start},       {"lost while off", lost_while_off},
    {"command is NaN", command_is_nan},
    {"measures", measures},                     {"jitter", jitter},
    {"slow clock", slow_clock},
};
enum { CASES = sizeof cases / sizeof *cases };

int main(int count, char **arguments)
{
    const int number = count == 3 ? atoi(arguments[1]) : -1;
    if (number < 0 || number >= REFUSALS + CASES) {
        printf("%d\n", REFUSALS + CASES);
        return count != 1;
    }
    epoch_file = arguments[2];
    printf("%s\n", number < REFUSALS ? refusals[number].name : cases[number - REFUSALS].name);
    if (number < REFUSALS) {
        refuses(&refusals[number]);
    } else {
        cases[number - REFUSALS].run();
    }
    return 0;
}
