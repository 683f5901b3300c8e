# Simulated drives with absolute encoders: each starts at home and then stands where its last command was.
# Joints are connected as at a machine: joint.N.motor-pos-cmd -> drive -> joint.N.motor-pos-fb.

set joints $::KINS(JOINTS)

loadrt $::KINS(KINEMATICS)
loadrt $::EMCMOT(EMCMOT) servo_period_nsec=$::EMCMOT(SERVO_PERIOD) num_joints=$joints
loadrt flipflop
loadrt mux2 count=$joints

addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf flipflop.0 servo-thread

# Until the machine is switched on for the first time the encoders read home.
net drives-on motion.motion-enabled => flipflop.0.set
net drives-follow flipflop.0.out
for {set joint 0} {$joint < $joints} {incr joint} {
    addf mux2.$joint servo-thread
    net drives-follow => mux2.$joint.sel
    net home-$joint gantrytaukins.home-$joint => mux2.$joint.in0
    net command-$joint joint.$joint.motor-pos-cmd => mux2.$joint.in1
    net feedback-$joint mux2.$joint.out => joint.$joint.motor-pos-fb
}

# No emergency stop and no tool changer.
net enable-loop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net tool-prepare-loop iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net tool-change-loop iocontrol.0.tool-change => iocontrol.0.tool-changed
