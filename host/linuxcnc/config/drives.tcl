# Simulated drives with absolute encoders, and gantry_tau between them and the motion controller:
#     joint.N.motor-pos-cmd -> gantry-tau.N.nominal    gantry-tau.N.reference -> drive -> gantry-tau.N.position    gantry-tau.N.feedback -> joint.N.motor-pos-fb
# A drive starts at home, lags behind its reference (by two to three periods), and stands where it is while it is off.

set joints $::KINS(JOINTS)

loadrt $::KINS(KINEMATICS)
loadrt $::EMCMOT(EMCMOT) servo_period_nsec=$::EMCMOT(SERVO_PERIOD) num_joints=$joints
# The INI file's values are lists with one element per line of that name.
loadrt gantry_tau {*}[join $::GANTRY_TAU(PARAMETERS)]
loadrt flipflop
loadrt mux2 count=[expr {2 * $joints}]
loadrt lowpass count=$joints
loadrt not

source [file join [file dirname [info script]] check.tcl]

# A period: the drives are read, LinuxCNC plans, the drives are written.
addf flipflop.0 servo-thread
addf not.0 servo-thread
for {set joint 0} {$joint < $joints} {incr joint} {
    addf mux2.[expr {2 * $joint}] servo-thread
    addf mux2.[expr {2 * $joint + 1}] servo-thread
    addf lowpass.$joint servo-thread
}
addf gantry-tau.read servo-thread
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf gantry-tau.write servo-thread

# Off is a stop, and LinuxCNC switches on what may be switched on.
net drives-on motion.motion-enabled => gantry-tau.enable flipflop.0.set not.0.in
net drives-off not.0.out
net permit gantry-tau.permit => motion.enable

# Until the machine is switched on for the first time the encoders read home.
net drives-known flipflop.0.out
for {set joint 0} {$joint < $joints} {incr joint} {
    set stand mux2.[expr {2 * $joint}]
    set move mux2.[expr {2 * $joint + 1}]
    net drives-known => $stand.sel
    net home-$joint gantrytaukins.home-$joint => $stand.in0
    net stand-$joint $stand.out => $move.in0
    net drives-on => $move.sel
    net target-$joint $move.out => lowpass.$joint.in
    net drives-off => lowpass.$joint.load
    setp lowpass.$joint.gain 0.5

    net command-$joint joint.$joint.motor-pos-cmd => gantry-tau.$joint.nominal
    net reference-$joint gantry-tau.$joint.reference => $move.in1
    net position-$joint lowpass.$joint.out => gantry-tau.$joint.position $stand.in1
    net feedback-$joint gantry-tau.$joint.feedback => joint.$joint.motor-pos-fb
}

# The operator's: `halcmd sets rearm 1`, or a button. The force sensor's: `halcmd sets wrench-0 300`, or a driver.
net rearm gantry-tau.rearm
net stop gantry-tau.stop
for {set i 0} {$i < 6} {incr i} { net wrench-$i gantry-tau.wrench-$i }
net wrench-valid gantry-tau.wrench-valid
sets wrench-valid 1

# No emergency stop and no tool changer.
net enable-loop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net tool-prepare-loop iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net tool-change-loop iocontrol.0.tool-change => iocontrol.0.tool-changed
