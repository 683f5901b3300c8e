(** The rows of proofs/manifest.toml that the composition rests on, as axioms over unknown functions of
    core. The data types and what is called valid are transcribed from core; no function of core is
    modelled. How to read it: ../composition.md. *)
From Coq Require Import ZArith List Bool.
Import ListNotations.
Open Scope Z_scope.

(** * Data *)

Inductive Phase := Listening | Handshake | Submit | Obtain | SafeDisconnect | Fault.
Inductive Action := Hold | Follow | FollowZero | Ramp.
Inductive Mode := ToSubmit | ToObtain.
(** The three channels of an axis. *)
Inductive Kind := Position | Velocity | Torque.

(** [FsmState], core/src/control/session/fsm.rs. *)
Record FsmState := {
  phase : Phase; owner : option nat; epoch : nat; accepted : nat; tick_number : nat; misses : nat;
  history : N; waited : nat; rearm_released : bool; latched : bool }.

(** [FsmInput], there. *)
Record FsmInput := {
  stop : bool; quit : bool; rearm : bool; nominal_fault : bool; framing : bool; flood : bool;
  closed : bool; goodbye : bool; agitated : bool; command : option (nat * Mode);
  hello : option (nat * nat); skipped : nat; all_zero : bool }.

(** [FsmInput::default]. *)
Definition no_input := {|
  stop := false; quit := false; rearm := false; nominal_fault := false; framing := false;
  flood := false; closed := false; goodbye := false; agitated := false; command := None;
  hello := None; skipped := 0; all_zero := false |}.

(** [Decision]; of its end only whether it is by the budget of misses. *)
Record Decision := { next : FsmState; action : Action; by_budget : bool }.
Record Rules := { handshake_ticks : nat; budget : option nat }.

Definition is_live s := match phase s with Handshake | Submit | Obtain => true | _ => false end.
Definition is_over s := match phase s with SafeDisconnect | Fault => true | _ => false end.
Definition is_running s := match phase s with Submit | Obtain => true | _ => false end.

(** [FsmState::is_valid]. *)
Definition discrete_valid (ticks : nat) (s : FsmState) : Prop :=
  match phase s with
  | Listening => owner s = None
  | Handshake | Submit | Obtain => owner s <> None
  | SafeDisconnect | Fault => True
  end /\
  misses s = (if is_running s then Nat.b2n (N.odd (history s)) else 0%nat) /\
  match phase s with
  | Handshake => (waited s < ticks)%nat /\ history s = 0%N
  | _ => waited s = 0%nat
  end /\
  (phase s = Fault \/ rearm_released s = false /\ latched s = false).

(** [Channel] and [Limits]: M, S, A, rho. *)
Record Channel := { count : Z; change : Z }.
Record Limits := { largest : Z; step_limit : Z; accel : Z; rho : Z }.
Definition channel_valid l c := Z.abs (count c) <= largest l /\ Z.abs (change c) <= step_limit l.
Definition admits l v := Z.abs v <= largest l.
Definition at_zero c := count c = 0 /\ change c = 0.

(** [Axis], core/src/control/session/act.rs; [others]: its fields of which no row speaks. *)
Record Axis := {
  channels : Kind -> Channel; shadow : Kind -> Channel; nominal : Z; agitation : Z; others : Z }.

Record AxisCommand := {
  to_do : Action; obtains : bool; shadow_to_do : option Action; target : Kind -> Z; nominal_now : Z;
  remaining : Z }.
Record Reference := { position : Z; pushes : Kind -> Z }.
Record InForce := { nominal_in_force : Z; offsets_in_force : Kind -> Z }.

(** [Parts] of a session, but its diagnostics. *)
Record Server := {
  discrete : FsmState; axes : nat -> Axis; withheld : bool; off_path : bool; paced : bool; noted : Z }.

(** [TickInput]; a reading: nominal reference and measurements of each axis. *)
Record TickInput := {
  reading : option (nat -> Z * Z); at_stop : bool; at_quit : bool; at_rearm : bool; elapsed : nat }.
Inductive LastWrite := Taken | Refused (found : nat -> InForce) | Unknown.
Record Accepted := { asked : FsmInput; targets : nat -> Kind -> Z }.
Record Order := {
  do_all : Action; all_obtain : bool; shadows : option Action; flags : nat -> Z; is_paced : bool;
  holds : bool }.
Record Output := { references : nat -> Reference; is_withheld : bool }.
Record Start := { in_force : nat -> InForce; stop_latched : bool }.

(** [Accepted::nothing]. *)
Definition nothing := {| asked := no_input; targets := fun _ _ => 0 |}.
Definition is_read i := match reading i with Some _ => true | None => false end.
Definition clamp lower upper x := Z.min upper (Z.max lower x).
(** A ramp step: [min(rho, |value|)] towards zero. *)
Definition ramped l before after :=
  Z.abs (count after) = Z.abs (count before) - Z.min (rho l) (Z.abs (count before)) /\
  (count after = 0 \/ (0 < count after <-> 0 < count before)).

(** Action of the shadows. *)
Definition shadow_of p (f : FsmInput) :=
  match p, command f with
  | Submit, Some _ => Some Follow
  | Submit, None => Some Hold
  | _, _ => None
  end.

(** [u32::MAX]: a sum of agitation goes no further. *)
Definition largest_sum := 4294967295.

(** [is_new]: epoch and sequence of an input are above those of the state. *)
Definition is_new s f :=
  (forall from e, hello f = Some (from, e) -> (epoch s < e)%nat) /\
  (forall sequence mode, command f = Some (sequence, mode) -> (accepted s < sequence)%nat).

(** Something of higher precedence than a miss. *)
Definition outranks_a_miss f :=
  stop f || quit f || nominal_fault f || framing f || flood f || closed f || goodbye f || agitated f.

(** * Rows *)

(** Configurations, and functions of core that terms are about. *)
Module Type FUNCTIONS.

  (** Number of axes. *)
  Parameter N : nat.
  (** Configurations, and axes in them, that validation accepts. *)
  Parameters Config AxisConfig : Type.
  Parameter rules : Config -> Rules.
  Parameter axis_config : Config -> nat -> AxisConfig.
  Parameter limits : AxisConfig -> Kind -> Limits.
  Parameters lower upper : AxisConfig -> Z.
  Parameter accel_is_fault : AxisConfig -> bool.
  (** Budget of agitation: r, nm per tick; its limit is a thousand times that. *)
  Parameter refill : AxisConfig -> option Z.
  (** Events of the network, and the epochs that may be granted. *)
  Parameters Event Epochs : Type.
  (** Connections over datagrams to an endpoint with keys, each with what its datagrams are judged by at
      a time ([Door] of the properties); and the bytes of datagrams. *)
  Parameters Door Bytes : Type.

  (** Functions of core. *)
  Parameter decide : FsmState -> FsmInput -> Rules -> Decision.
  Parameter act : Axis -> AxisCommand -> AxisConfig -> Axis * Reference.
  Parameter held : Axis -> Axis * Reference.
  Parameter value : Kind -> Channel -> Z.
  Parameter nominal_stepped : Z -> Z -> AxisConfig -> nat -> bool.
  Parameter nominal_accelerated : Axis -> Z -> AxisConfig -> bool.
  Parameter is_agitated : Axis -> AxisConfig -> bool.
  (** The position loop of a drive that takes velocities: its state, and that it is valid. *)
  Parameters PositionLoop LoopConfig LoopInput : Type.
  Parameter loop_valid : LoopConfig -> PositionLoop -> Prop.
  (** The velocity in force, um/s, and what a tick of the ramp takes from it. *)
  Parameter velocity : PositionLoop -> Z.
  Parameter velocity_ramp : LoopConfig -> Z.
  Parameter is_stopped : PositionLoop -> bool.
  Parameters is_permitted has_actual : LoopInput -> bool.
  Parameter loop_tick : LoopConfig -> PositionLoop -> LoopInput -> PositionLoop.
End FUNCTIONS.

(** What rows call valid, within limits, complete. *)
Module Terms (F : FUNCTIONS).
  Import F.

  Definition channels_valid (g : AxisConfig) (of_axis : Kind -> Channel) :=
    forall k, channel_valid (limits g k) (of_axis k).
  Definition channels_at_zero (of_axis : Kind -> Channel) := forall k, at_zero (of_axis k).
  Definition axis_valid p (g : AxisConfig) a :=
    channels_valid g (channels a) /\ channels_valid g (shadow a) /\
    (p = Listening \/ p = Handshake \/ p = Submit -> channels_at_zero (channels a)) /\
    (p = Submit \/ channels_at_zero (shadow a)) /\
    (p = Obtain /\ refill g <> None \/ agitation a = 0).
  Definition valid c s :=
    discrete_valid (handshake_ticks (rules c)) (discrete s) /\
    (forall i, (i < N)%nat -> axis_valid (phase (discrete s)) (axis_config c i) (axes s i)) /\
    (withheld s = true -> is_over (discrete s) = true).

  Definition offsets a k := value k (channels a k).
  Definition demanded s i :=
    {| nominal_in_force := nominal (axes s i); offsets_in_force := offsets (axes s i) |}.
  Definition within_limits c (found : nat -> InForce) :=
    forall i k, (i < N)%nat -> admits (limits (axis_config c i) k) (offsets_in_force (found i) k).

  Definition every (test : nat -> bool) := forallb test (seq 0 N).
  Definition any (test : nat -> bool) := existsb test (seq 0 N).
  Definition all_kinds (test : Kind -> bool) := test Position && test Velocity && test Torque.
  Definition is_at_zero a := all_kinds (fun k => offsets a k =? 0).
  Definition cycles i := Nat.max 1 (elapsed i).
  Definition paces s i := (elapsed i <=? 1)%nat && is_read i && negb (off_path s).
  Definition has_stepped c s i axis :=
    match reading i with
    | Some read => nominal_stepped (nominal (axes s axis)) (fst (read axis)) (axis_config c axis) (cycles i)
    | None => false
    end.
  Definition stops_by_accel c s i axis :=
    match reading i with
    | Some read =>
        accel_is_fault (axis_config c axis) && paced s && paces s i &&
        nominal_accelerated (axes s axis) (fst (read axis)) (axis_config c axis)
    | None => false
    end.

  (** [decided_on]: the complete input of the decision. *)
  Definition complete c s i (refused : bool) a :=
    let f := asked a in {|
    stop := stop f || at_stop i || negb (is_read i) || refused;
    quit := at_quit i;
    rearm := at_rearm i;
    nominal_fault := any (fun axis => has_stepped c s i axis || stops_by_accel c s i axis);
    framing := framing f; flood := flood f; closed := closed f; goodbye := goodbye f;
    agitated := any (fun axis => is_agitated (axes s axis) (axis_config c axis));
    command := command f; hello := hello f;
    skipped := cycles i - 1;
    all_zero := negb (withheld s) && every (fun axis => is_at_zero (axes s axis)) |}.

  (** The command of an order to an axis. *)
  Definition command_of (o : Order) i a (own : Axis) axis remaining := {|
    to_do := do_all o; obtains := all_obtain o; shadow_to_do := shadows o; target := targets a axis;
    nominal_now :=
      match reading i with
      | Some read => if holds o then nominal own else fst (read axis)
      | None => nominal own
      end;
    remaining := remaining |}.
  (** What an axis does with a command, or without one. *)
  Definition act_or_hold a (m : option (AxisCommand * AxisConfig)) :=
    match m with Some (m, g) => act a m g | None => held a end.
End Terms.

(** All functions of core, and the terms. *)
Module Type CORE.
  Include FUNCTIONS.
  Include Terms.

  (** [Door::is_authentic] of the properties: a frame has the tag of who may be heard. *)
  Parameter is_authentic : Door -> Bytes -> bool.
  (** The event of a datagram, if it has one. *)
  Parameter take : Door -> Bytes -> option Event.
  Parameter sift : Config -> Server -> Epochs -> nat * Event -> Accepted -> Accepted.
  Parameter classify : Config -> Server -> Epochs -> list (nat * Event) -> Accepted.
  Parameter order : Config -> Server -> TickInput -> bool -> Accepted -> Decision * FsmInput * Order.
  Parameter carry_out : Config -> (nat -> Axis) -> Order -> TickInput -> Accepted ->
    (Axis -> option (AxisCommand * AxisConfig) -> Axis * Reference) -> nat -> Axis * Reference.
  Parameter settle : Config -> Server -> LastWrite -> Server.
  Parameter step : Config -> Server -> TickInput -> bool -> Accepted -> Server * Output.
  Parameter tick :
    Config -> Server -> LastWrite -> list (nat * Event) -> Epochs -> TickInput -> Server * Output.
  Parameter start : Config -> Start -> option Server.
End CORE.

(** What several rows say, of three axes and of six, or of a kind of channel. *)
Module Statements (C : CORE).
  Import C.

  (* says: "T1: |change| <= S" *)
  (* says: "T3: |value| <= M" *)
  (* says: "the invariant is kept" *)
  (* says: "the change is what changed" *)
  (* says: "T2: |change of change| <= A" *)
  (* says: "T5: never past zero" *)
  (* says: "T5: exactly min(rho, |value|)" *)
  (* says: "T3: inside the travel" *)
  (* says: "T3: the reference is nominal plus offset, clamped to the travel" *)
  (* says: "T3: the nominal reference is noted" *)
  (* says: "the drive receives the channel" *)
  Definition bounded_in (k : Kind) := forall a m g,
    channels_valid g (channels a) -> channels_valid g (shadow a) ->
    let (after, reference) := act a m g in
    let l := limits g k in
    let before_k := channels a k in let after_k := channels after k in
    Z.abs (count after_k - count before_k) <= step_limit l /\
    admits l (value k after_k) /\
    channel_valid l after_k /\
    count after_k - count before_k = change after_k /\
    Z.abs (change after_k - change before_k) <= accel l /\
    (to_do m = Ramp -> ramped l before_k after_k) /\
    position reference = clamp (lower g) (upper g) (nominal_now m + offsets after Position) /\
    lower g <= position reference <= upper g /\
    nominal after = nominal_now m /\
    pushes reference Velocity = offsets after Velocity /\ pushes reference Torque = offsets after Torque.

  (* says: "T12: the invariant is kept" *)
  (* says: "T12: nothing to settle" *)
  (* says: "T12: the session is over" *)
  (* says: "T12: withheld unless the values in force are known and valid" *)
  (* says: "T12: goes on from the values in force" *)
  (* says: "T2: goes on at rest" *)
  (* says: "T12: keeps what it believes" *)
  (* says: "T23: a write changes no epoch, no sequence and no owner" *)
  Definition settles := forall c s fate, valid c s -> let after := settle c s fate in
    valid c after /\
    match fate with
    | Taken => after = s
    | Refused found =>
        is_over (discrete after) = true /\ (~ within_limits c found -> withheld after = true) /\
        (within_limits c found -> forall i, (i < N)%nat ->
          (forall k, offsets (axes after i) k = offsets_in_force (found i) k) /\
          nominal (axes after i) = nominal_in_force (found i) /\
          (forall k, change (channels (axes after i) k) = 0))
    | Unknown => is_over (discrete after) = true /\ withheld after = true /\
        forall i, (i < N)%nat -> channels (axes after i) = channels (axes s i)
    end /\
    epoch (discrete after) = epoch (discrete s) /\ accepted (discrete after) = accepted (discrete s) /\
    rearm_released (discrete after) = rearm_released (discrete s).

  (* says: "T9: the decision sees what is known" *)
  (* says: "T9: ordered is what is decided" *)
  Definition orders := forall c s i refused a, valid c s ->
    let '(d, f, o) := order c s i refused a in
    f = complete c s i refused a /\ do_all o = action d /\
    all_obtain o = (match phase (next d) with Obtain => true | _ => false end) /\
    shadows o = shadow_of (phase (next d)) f /\
    holds o = (negb (is_read i) || off_path s && nominal_fault f).

  (* says: "T9: ordered by the rules" *)
  Definition decides := forall c s i refused a, valid c s ->
    let '(d, _, _) := order c s i refused a in
    d = decide (discrete s) (complete c s i refused a) (rules c).

  (* says: "T9: the session goes on as decided" *)
  (* says: "T1: the axes are what they became" *)
  (* says: "T3: the references are those of the axes" *)
  (* says: "T21: a step changes nothing of what is withheld" *)
  (* says: "T21: off the path if the axes were held" *)
  Definition has_parts := forall c s i refused a, valid c s ->
    let '(d, _, o) := order c s i refused a in
    let (after, out) := step c s i refused a in
    let acted := carry_out c (axes s) o i a act_or_hold in
    discrete after = next d /\
    (forall axis, (axis < N)%nat ->
      axes after axis = fst (acted axis) /\ references out axis = snd (acted axis)) /\
    withheld after = withheld s /\ is_withheld out = withheld s /\ off_path after = holds o.

  (* says: "T1: an axis acts once" *)
  (* says: "T1: an axis acts from its own state" *)
  (* says: "T1: an axis acts on its own command" *)
  (* says: "T1: an axis goes on as it acted" *)
  Definition act_by_themselves := forall c s i a o by_itself axis, valid c s -> (axis < N)%nat ->
    exists remaining, carry_out c (axes s) o i a by_itself axis =
      by_itself (axes s axis) (Some (command_of o i a (axes s axis) axis remaining, axis_config c axis)).

  (* says: "T12: a tick is its parts" *)
  (* says: "T12: a tick knows of the drives what its parts know" *)
  (* says: "T12: the references of a tick are those of its step" *)
  Definition tick_has_parts := forall c s fate events epochs i, valid c s ->
    let settled := settle c s fate in
    let refused := match fate with Taken => false | _ => true end in
    let (after, out) := tick c s fate events epochs i in
    let (stepped, of_step) := step c settled i refused (classify c settled epochs events) in
    discrete after = discrete stepped /\
    (forall axis, (axis < N)%nat -> axes after axis = axes stepped axis /\
      references out axis = references of_step axis) /\
    withheld after = withheld stepped /\ off_path after = off_path stepped /\
    is_withheld out = is_withheld of_step.

  (* says: "T12: a session starts valid" *)
  (* says: "T21: a server starts with what is in force" *)
  (* says: "T21: a server that starts may write" *)
  (* says: "T21: and waits for the path" *)
  (* says: "T9: a latched stop outlives the server" *)
  (* says: "T9: a stuck re-arm leads nowhere" *)
  Definition starts := forall c told,
    match start c told with
    | None => True
    | Some s => within_limits c (in_force told) /\ valid c s /\
        (forall i, (i < N)%nat -> nominal (axes s i) = nominal_in_force (in_force told i) /\
          forall k, offsets (axes s i) k = offsets_in_force (in_force told i) k) /\
        withheld s = false /\ off_path s = true /\
        (stop_latched told = true -> phase (discrete s) = Fault) /\
        rearm_released (discrete s) = false
    end.
End Statements.

Module Type ROWS.
  Include CORE.
  Include Statements.

  (** ** The decision *)

  (* says: "the invariant is kept" *)
  Axiom decide_keeps_the_invariant : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> discrete_valid (handshake_ticks r) (next (decide s f r)).

  (* says: "T4: the second consecutive miss ends the session" *)
  (* says: "T4: in that tick" *)
  (* says: "T4: one miss never ends a session" *)
  (* says: "T4: a miss is remembered for one deadline" *)
  (* says: "T4: one miss never leaves Obtain" *)
  (* says: "T4: one miss holds" *)
  Axiom decide_second_miss_ends : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> is_running s = true -> outranks_a_miss f = false ->
    let d := decide s f r in
    let in_a_row := (misses s + skipped f)%nat in
    if (2 <=? in_a_row)%nat || (in_a_row =? 1)%nat && (match command f with None => true | _ => false end)
    then phase (next d) = SafeDisconnect /\ action d = Ramp
    else if by_budget d then True
    else is_running (next d) = true /\
      match command f with
      | None => misses (next d) = 1%nat /\ phase (next d) = phase s /\ action d = Hold
      | Some _ => misses (next d) = 0%nat
      end.

  (* says: "T6: a session begins in Listening" *)
  (* says: "T6: it is granted to who asked" *)
  (* says: "T6: Listening begins at zero" *)
  Axiom decide_authority_needs_zero : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> let n := next (decide s f r) in
    (is_live n = true -> is_live s = false -> phase s = Listening /\ phase n = Handshake /\
      exists from, hello f = Some (from, epoch n) /\ owner n = Some from) /\
    (phase n = Listening -> phase s <> Listening -> all_zero f = true).

  (* says: "T9: a stop ends in Fault" *)
  (* says: "T9: a stop ramps" *)
  (* says: "T9: a re-arm is seen released in Fault" *)
  (* says: "T9: nothing else leads out of Fault" *)
  Axiom decide_stop_leads_to_fault : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> let d := decide s f r in
    (stop f || quit f || nominal_fault f = true -> phase (next d) = Fault /\ action d = Ramp) /\
    rearm_released (next d) =
      (match phase (next d) with Fault => true | _ => false end && (rearm_released s || negb (rearm f))) /\
    (phase s = Fault -> rearm f && rearm_released s && all_zero f = false ->
      phase (next d) = Fault).

  (* says: "T5: every tick ramps" *)
  (* says: "T5: no session meanwhile" *)
  Axiom decide_no_session_ramps : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> let d := decide s f r in
    is_over s = true -> all_zero f = false -> action d = Ramp /\ is_live (next d) = false.

  (* says: "T22: a server that listens goes on" *)
  (* says: "T22: a handshake counts to its end" *)
  (* says: "T22: the second tick of silence ends the session" *)
  (* says: "T22: at zero it listens" *)
  (* says: "T22: the ramp goes on" *)
  Axiom decide_silence_leads_to_listening : forall s zero shaken r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s ->
    let d := decide s {| stop := false; quit := false; rearm := false; nominal_fault := false;
      framing := false; flood := false; closed := false; goodbye := false; agitated := shaken;
      command := None; hello := None; skipped := 0; all_zero := zero |} r in
    let over := phase (next d) = SafeDisconnect /\ action d = Ramp in
    match phase s with
    | Listening => phase (next d) = Listening
    | Handshake => phase (next d) = Handshake /\ waited (next d) = S (waited s) \/ over
    | Submit | Obtain =>
        misses s = 0%nat /\ misses (next d) = 1%nat /\ phase (next d) = phase s \/ over
    | SafeDisconnect => if zero then phase (next d) = Listening else over
    | Fault => True
    end.

  (* says: "T23: an epoch is never given twice" *)
  (* says: "T23: a grant changes the epoch" *)
  (* says: "T23: a grant raises the epoch" *)
  (* says: "T23: the accepted sequence never falls" *)
  (* says: "T23: a command acts once" *)
  Axiom decide_epochs_and_sequences_rise : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> is_new s f ->
    let d := decide s f r in
    if (epoch (next d) =? epoch s)%nat
    then (phase (next d) = Handshake -> phase s = Handshake) /\ (accepted s <= accepted (next d))%nat /\
      (action d = Follow \/ action d = FollowZero -> (accepted s < accepted (next d))%nat)
    else (epoch s < epoch (next d))%nat /\ phase s = Listening /\ phase (next d) = Handshake.

  (* says: "T33: agitation ends the session" *)
  Axiom agitation_ends_a_session : forall s f r, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> agitated f = true -> is_live s = true ->
    is_over (next (decide s f r)) = true /\ action (decide s f r) = Ramp.

  (** ** An axis *)

  Axiom axis_position_is_bounded : bounded_in Position.
  Axiom axis_velocity_is_bounded : bounded_in Velocity.
  Axiom axis_torque_is_bounded : bounded_in Torque.

  (* says: "T3: a valid channel fits its unit" *)
  Axiom channel_value_is_its_count : forall g k h,
    channel_valid (limits g k) h -> value k h = count h.

  (* says: "T9: what stands has not stepped" *)
  Axiom nominal_that_stands_is_within : forall x g n, nominal_stepped x x g n = false.

  (* says: "T6: an axis stays valid, whatever the others do" *)
  Axiom session_axis_of_many_stays_valid : forall a g s f r m, (0 < handshake_ticks r)%nat ->
    discrete_valid (handshake_ticks r) s -> axis_valid (phase s) g a ->
    (all_zero f = true -> forall k, count (channels a k) = 0) ->
    let d := decide s f r in
    to_do m = action d -> obtains m = (match phase (next d) with Obtain => true | _ => false end) ->
    shadow_to_do m = shadow_of (phase (next d)) f ->
    axis_valid (phase (next d)) g (fst (act a m g)).

  (* says: "T33: an axis counts its second difference" *)
  (* says: "T33: nothing counts outside Obtain" *)
  (* says: "T33: nothing counts without a budget" *)
  (* says: "T33: an axis is agitated beyond its own limit" *)
  Axiom agitation_of_an_axis_is_counted : forall a m g,
    channels_valid g (channels a) -> channels_valid g (shadow a) ->
    let after := fst (act a m g) in
    let second_difference := Z.abs (change (channels after Position) - change (channels a Position)) in
    agitation after =
      match refill g with
      | Some r =>
          if obtains m then Z.max 0 (Z.min (agitation a + second_difference) largest_sum - r) else 0
      | None => 0
      end /\
    is_agitated a g = match refill g with Some r => 1000 * r <? agitation a | None => false end.

  (** ** A tick *)

  Axiom total_write : N = 3%nat -> settles.
  Axiom total_write_of_six : N = 6%nat -> settles.

  Axiom session_orders_what_is_decided : N = 3%nat -> orders.
  Axiom session_of_6_axes_orders_what_is_decided : N = 6%nat -> orders.

  Axiom session_decides_by_the_rules : N = 3%nat -> decides.
  Axiom session_of_6_axes_decides_by_the_rules : N = 6%nat -> decides.

  Axiom session_step_is_its_parts : N = 3%nat -> has_parts.
  Axiom session_of_6_axes_step_is_its_parts : N = 6%nat -> has_parts.

  Axiom session_of_3_axes_acts_axis_by_axis : N = 3%nat -> act_by_themselves.
  Axiom session_of_6_axes_acts_axis_by_axis : N = 6%nat -> act_by_themselves.

  Axiom session_tick_is_its_parts : N = 3%nat -> tick_has_parts.
  Axiom session_of_6_axes_tick_is_its_parts : N = 6%nat -> tick_has_parts.

  (* says: "T7: a non-owner decides nothing" *)
  Axiom sift_only_the_owner_decides : N = 3%nat -> forall c s epochs from event a, valid c s ->
    owner (discrete s) <> Some from -> phase (discrete s) <> Listening ->
    sift c s epochs (from, event) a = a.

  (* says: "T23: only new epochs and sequences are accepted" *)
  Axiom sift_accepts_only_what_is_new : N = 3%nat -> forall c s epochs event a, valid c s ->
    is_new (discrete s) (asked a) -> is_new (discrete s) (asked (sift c s epochs event a)).

  (* says: "T27: a datagram is judged at once" *)
  (* says: "T27: a forgery has no event" *)
  (* says: "T27: a forgery ends no session over datagrams" *)
  (* says: "T27: a broken stream ends the owner's own connection" *)
  Axiom slot_forgery_is_nothing : N = 3%nat -> forall door bytes,
    is_authentic door bytes = false -> take door bytes = None.

  (** ** Position loops *)

  (* says: "T17: the loop stays valid" *)
  Axiom position_loop_references_are_bounded : forall c l input,
    loop_valid c l -> loop_valid c (loop_tick c l input).

  (* says: "T18: without a permit it stops" *)
  (* says: "T18: without an actual value it stops" *)
  (* says: "T18: a bound from above falls by rho" *)
  (* says: "T18: a bound from below falls by rho" *)
  Axiom position_loop_stops_with_its_ramp : forall c l input bound,
    loop_valid c l -> 0 <= bound <= 4294967295 ->
    let after := loop_tick c l input in
    let lowered := Z.max 0 (bound - velocity_ramp c) in
    (is_permitted input = false -> is_stopped after = true) /\
    (has_actual input = false -> is_stopped after = true) /\
    (is_stopped after = true ->
      (Z.abs (velocity l) <= bound -> Z.abs (velocity after) <= lowered) /\
      (bound <= Z.abs (velocity l) -> lowered <= Z.abs (velocity after))).

  (** ** The start *)

  Axiom total_start : N = 3%nat -> starts.
  Axiom total_start_of_six : N = 6%nat -> starts.

  (** ** Types with private fields *)

  (** [Limits::new] refuses others. *)
  Axiom type_limits : forall g k, 0 <= largest (limits g k) /\ 0 <= rho (limits g k).
  (** [AgitationBudget::new] refuses others. *)
  Axiom type_budget : forall g r, refill g = Some r -> 0 <= r <= 1000000.
  (** [Config::new] refuses others. *)
  Axiom type_config : forall c, (0 < handshake_ticks (rules c))%nat.

  (** A velocity is an [i32]; [Limits::new] refuses a negative ramp. *)
  Axiom type_loop : forall c l, loop_valid c l -> Z.abs (velocity l) <= 2147483648 /\ 0 <= velocity_ramp c.

  (** ** Read from the source *)

  (** [Session::classify], core/src/control/session.rs: from nothing, one event after the other. *)
  Axiom read_classify_is_one_by_one : forall c s epochs events,
    classify c s epochs events = fold_left (fun a event => sift c s epochs event a) events nothing.

End ROWS.
