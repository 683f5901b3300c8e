# Refuses a configuration that is not of the machine that the modules were built for. After `loadrt` of both.

proc refuse {why} {
    puts stderr "gantry_tau: $why"
    exit 1
}

# Values of pins; whole numbers may be printed in hexadecimal.
proc value {pin} { return [expr {[string trim [hal getp $pin]] + 0}] }
proc has {pin} { return [expr {![catch {hal getp $pin}]}] }

set joints $::KINS(JOINTS)
set axes 0
while {[has gantry-tau.$axes.travel-lower]} { incr axes }
if {$axes != $joints} { refuse "\[KINS\]JOINTS = $joints, but the modules are built for a machine with $axes joints (make ROBOT=...)" }
if {[value gantrytaukins.checksum] != [value gantry-tau.checksum]} {
    refuse "gantrytaukins and gantry_tau are built for different machines: build both with one make, and install both"
}
for {set joint 0} {$joint < $joints} {incr joint} {
    foreach {key pin outside} {MIN_LIMIT travel-lower < MAX_LIMIT travel-upper >} {
        set limit [set ::JOINT_${joint}($key)]
        set end [value gantry-tau.$joint.$pin]
        # A ten-thousandth for the rounding of degrees.
        if {[expr "$limit $outside $end [expr {$outside eq {<} ? {-} : {+}}] 1e-4"]} {
            refuse "\[JOINT_$joint\]$key = $limit, beyond the nominal travel of the robot file, $end"
        }
    }
}
