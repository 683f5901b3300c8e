(** Runs of a server and its drives, and what holds of every one of them. *)
From Coq Require Import ZArith List Bool Lia.
From Composition Require Import Rows.
Open Scope Z_scope.

Module Runs (R : ROWS).
Import R.

(** * What may happen *)

(** A server, the values in force at its drives, and whether these took the last references. *)
Record World := { server : Server; drives : nat -> InForce; took : bool }.

Definition same (one other : nat -> InForce) := forall i, (i < N)%nat ->
  nominal_in_force (one i) = nominal_in_force (other i) /\
  forall k, offsets_in_force (one i) k = offsets_in_force (other i) k.

(** The host says of the last write no more than the drives do. *)
Definition truthful w fate :=
  match fate with
  | Taken => took w = true
  | Refused found => same found (drives w)
  | Unknown => True
  end.

(** Everything that reaches a tick. *)
Record Input := {
  fate : LastWrite; events : list (nat * Event); epochs : Epochs; cycle : TickInput }.

(** After a tick the drives took its references, if it was to write any; else they have anything. *)
Definition one_tick c w input w' out :=
  truthful w (fate input) /\
  tick c (server w) (fate input) (events input) (epochs input) (cycle input) = (server w', out) /\
  (took w' = true -> is_withheld out = false /\ same (drives w') (demanded (server w'))).

(** A new server, with what is in force at the drives. *)
Definition started c told w :=
  start c told = Some (server w) /\ same (in_force told) (drives w).

(** A start, and any ticks after it. After a restart there is another run. *)
Inductive run c : World -> Prop :=
| begins told w : started c told w -> run c w
| goes_on w input w' out : run c w -> one_tick c w input w' out -> run c w'.

Section OfThreeAndSixAxes.
Hypothesis axes_are_three_or_six : N = 3%nat \/ N = 6%nat.

(** * A tick, of its parts *)

Lemma all_settle : settles.
Proof. destruct axes_are_three_or_six; auto using total_write, total_write_of_six. Qed.

Lemma all_start : starts.
Proof. destruct axes_are_three_or_six; auto using total_start, total_start_of_six. Qed.

(** What a tick decides on, what it decides, and whether the nominal references stand. *)
Definition settled c w input := settle c (server w) (fate input).
Definition refused input := match fate input with Taken => false | _ => true end.
Definition heard c w input := classify c (settled c w input) (epochs input) (events input).
Definition facts c w input :=
  complete c (settled c w input) (cycle input) (refused input) (heard c w input).
Definition decision c w input := decide (discrete (settled c w input)) (facts c w input) (rules c).
Definition stands c w input :=
  negb (is_read (cycle input)) || off_path (settled c w input) && nominal_fault (facts c w input).
Definition nominal_of c w input axis :=
  match reading (cycle input) with
  | Some read =>
      if stands c w input then nominal (axes (settled c w input) axis) else fst (read axis)
  | None => nominal (axes (settled c w input) axis)
  end.

(** Of a tick of a valid server: it goes on as decided, and every axis acts as decided. *)
Lemma tick_is_decided : forall c w input w' out,
  valid c (server w) -> one_tick c w input w' out ->
  let d := decision c w input in
  discrete (server w') = next d /\
  withheld (server w') = withheld (settled c w input) /\
  is_withheld out = withheld (settled c w input) /\
  off_path (server w') = stands c w input /\
  forall axis, (axis < N)%nat -> exists m,
    axes (server w') axis = fst (act (axes (settled c w input) axis) m (axis_config c axis)) /\
    references out axis = snd (act (axes (settled c w input) axis) m (axis_config c axis)) /\
    to_do m = action d /\
    obtains m = (match phase (next d) with Obtain => true | _ => false end) /\
    shadow_to_do m = shadow_of (phase (next d)) (facts c w input) /\
    nominal_now m = nominal_of c w input axis.
Proof.
  intros c w input w' out is_valid [_ [ticked _]] d.
  pose proof (all_settle c (server w) (fate input) is_valid) as [is_settled _].
  fold (settled c w input) in is_settled.
  assert (tick_has_parts /\ has_parts /\ decides /\ orders /\ act_by_themselves)
    as [parts_of_tick [parts_of_step [decides [ordered alone]]]].
  { destruct axes_are_three_or_six;
      repeat split; auto using session_tick_is_its_parts, session_of_6_axes_tick_is_its_parts,
        session_step_is_its_parts, session_of_6_axes_step_is_its_parts,
        session_decides_by_the_rules, session_of_6_axes_decides_by_the_rules,
        session_orders_what_is_decided, session_of_6_axes_orders_what_is_decided,
        session_of_3_axes_acts_axis_by_axis, session_of_6_axes_acts_axis_by_axis. }
  specialize (parts_of_tick c (server w) (fate input) (events input) (epochs input) (cycle input) is_valid).
  cbv zeta in parts_of_tick. rewrite ticked in parts_of_tick.
  fold (settled c w input) (refused input) in parts_of_tick. fold (heard c w input) in parts_of_tick.
  specialize (parts_of_step c (settled c w input) (cycle input) (refused input) (heard c w input) is_settled).
  specialize (decides c (settled c w input) (cycle input) (refused input) (heard c w input) is_settled).
  specialize (ordered c (settled c w input) (cycle input) (refused input) (heard c w input) is_settled).
  destruct (order c (settled c w input) (cycle input) (refused input) (heard c w input)) as [[found f] o].
  destruct (step c (settled c w input) (cycle input) (refused input) (heard c w input)) as [stepped of_step].
  destruct parts_of_tick as [tick_1 [tick_2 [tick_3 [tick_4 tick_5]]]].
  destruct parts_of_step as [step_1 [step_2 [step_3 [step_4 step_5]]]].
  destruct ordered as [order_1 [order_2 [order_3 [order_4 order_5]]]].
  fold (facts c w input) in decides, order_1. subst f. fold (decision c w input) in decides. fold d in decides.
  subst found.
  assert (holds o = stands c w input) as is_held by exact order_5.
  repeat split; try congruence.
  intros axis is_axis.
  destruct (alone c (settled c w input) (cycle input) (heard c w input) o act_or_hold axis is_settled is_axis)
    as [remaining carried].
  destruct (step_2 axis is_axis) as [same_axis same_reference].
  destruct (tick_2 axis is_axis) as [same_axis' same_reference'].
  rewrite carried in same_axis, same_reference. unfold act_or_hold in same_axis, same_reference.
  eexists. repeat split; [rewrite same_axis'; exact same_axis | rewrite same_reference'; exact same_reference | ..];
    simpl; try assumption.
  unfold nominal_of. rewrite <- is_held. reflexivity.
Qed.

Lemma live_or_over : forall s, is_live s = true \/ is_over s = true \/ phase s = Listening.
Proof. intros s. unfold is_live, is_over. destruct (phase s); auto. Qed.

Lemma over_is_not_live : forall s, is_over s = true -> is_live s = false.
Proof. intros s. unfold is_live, is_over. destruct (phase s); auto; discriminate. Qed.

(** What counts as zero is zero. *)
Lemma zero_is_zero : forall c s i refused a axis,
  valid c s -> all_zero (complete c s i refused a) = true -> (axis < N)%nat ->
  withheld s = false /\ forall k, count (channels (axes s axis) k) = 0 /\ offsets (axes s axis) k = 0.
Proof.
  intros c s i refused a axis [_ [are_valid _]] zero is_axis.
  simpl in zero. apply andb_prop in zero as [is_within zero].
  split; [destruct (withheld s); auto; discriminate|].
  unfold every in zero. rewrite forallb_forall in zero.
  assert (In axis (seq 0 N)) as within by (apply in_seq; lia).
  specialize (zero axis within). unfold is_at_zero, all_kinds in zero.
  apply andb_prop in zero as [zero torque]. apply andb_prop in zero as [place velocity].
  destruct (are_valid axis is_axis) as [are_channels _].
  intros k.
  assert (offsets (axes s axis) k = 0) as is_zero by (destruct k; apply Z.eqb_eq; assumption).
  split; [|exact is_zero].
  unfold offsets in is_zero. rewrite (channel_value_is_its_count _ _ _ (are_channels k)) in is_zero.
  exact is_zero.
Qed.

(** * Every state of a run is valid *)

Definition consistent c w :=
  valid c (server w) /\
  (took w = true -> withheld (server w) = false /\ same (drives w) (demanded (server w))).

Lemma settled_is_valid : forall c w input, consistent c w -> valid c (settled c w input).
Proof. intros c w input [is_valid _]. exact (proj1 (all_settle c (server w) (fate input) is_valid)). Qed.

Lemma settled_discrete : forall c w input, consistent c w ->
  discrete_valid (handshake_ticks (rules c)) (discrete (settled c w input)).
Proof. intros. apply (settled_is_valid c w input H). Qed.

Lemma taken_settles_nothing : forall c w input, consistent c w -> fate input = Taken ->
  settled c w input = server w.
Proof.
  intros c w input [is_valid _] is_taken. unfold settled.
  pose proof (all_settle c (server w) (fate input) is_valid) as [_ [by_fate _]].
  rewrite is_taken in *. exact by_fate.
Qed.

Lemma a_tick_is_consistent : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> consistent c w'.
Proof.
  intros c w input w' out is_consistent ticked.
  pose proof (settled_is_valid c w input is_consistent) as is_settled.
  pose proof (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [goes_on [same_withheld [out_withheld [_ acts]]]].
  destruct ticked as [_ [_ taken]].
  split; [|intros took_it; destruct (taken took_it); split; [congruence | assumption]].
  set (d := decision c w input) in *.
  pose proof is_settled as [discrete_is_valid [axes_are_valid withheld_is_over]].
  split; [|split].
  - rewrite goes_on. apply decide_keeps_the_invariant; auto using type_config.
  - intros axis is_axis. destruct (acts axis is_axis) as [m [is_next [_ [does [obtains [shadows _]]]]]].
    rewrite is_next, goes_on.
    refine (session_axis_of_many_stays_valid _ _ (discrete (settled c w input)) (facts c w input) (rules c) m
      _ _ _ _ does obtains shadows); auto using type_config.
    intros zero k. apply (zero_is_zero c (settled c w input) (cycle input) (refused input) (heard c w input)
      axis is_settled zero is_axis).
  - rewrite same_withheld. intros is_unknown. pose proof (withheld_is_over is_unknown) as was_over.
    assert (all_zero (facts c w input) = false) as not_zero by (simpl; rewrite is_unknown; reflexivity).
    rewrite goes_on.
    pose proof (decide_no_session_ramps (discrete (settled c w input)) (facts c w input) (rules c)
      (type_config c) discrete_is_valid) as ramps.
    destruct (decide_authority_needs_zero (discrete (settled c w input)) (facts c w input) (rules c)
      (type_config c) discrete_is_valid) as [_ needs_zero].
    destruct (ramps was_over not_zero) as [_ not_live].
    destruct (live_or_over (next d)) as [live | [over | listens]]; [unfold d, decision in *; congruence | exact over |].
    assert (all_zero (facts c w input) = true); [|congruence].
    apply needs_zero; [exact listens|].
    unfold is_over in was_over. destruct (phase (discrete (settled c w input))); discriminate.
Qed.

Lemma a_start_is_consistent : forall c told w, started c told w -> consistent c w.
Proof.
  intros c told w [is_started told_truth].
  pose proof (all_start c told) as starts. rewrite is_started in starts.
  destruct starts as [_ [is_valid [has [may_write _]]]]. split; [exact is_valid|].
  intros _. split; [exact may_write|]. intros i is_axis. destruct (has i is_axis) as [same_nominal same_offsets].
  destruct (told_truth i is_axis) as [told_nominal told_offsets]. simpl.
  split; [congruence|]. intros k. rewrite same_offsets. auto.
Qed.

(** In every state of a run the server is valid; and if the drives took its last references, they have
    what it demands, and it may write. *)
Theorem every_state_is_valid : forall c w, run c w -> consistent c w.
Proof. induction 1; eauto using a_start_is_consistent, a_tick_is_consistent. Qed.

(** * No offset jumps *)

(** What a channel of an axis does in a tick of a valid server. *)
Lemma channel_is_bounded : forall c w input w' out axis k,
  consistent c w -> one_tick c w input w' out -> (axis < N)%nat ->
  let l := limits (axis_config c axis) k in
  let before := channels (axes (settled c w input) axis) k in
  let after := channels (axes (server w') axis) k in
  Z.abs (count after - count before) <= step_limit l /\
  admits l (offsets (axes (server w') axis) k) /\
  count after - count before = change after /\
  Z.abs (change after - change before) <= accel l /\
  (action (decision c w input) = Ramp -> ramped l before after).
Proof.
  intros c w input w' out axis k is_consistent ticked is_axis l before after.
  pose proof (settled_is_valid c w input is_consistent) as [_ [are_valid _]].
  destruct (are_valid axis is_axis) as [own [shadow _]].
  pose proof (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [_ [_ [_ [_ acts]]]].
  destruct (acts axis is_axis) as [m [is_next [_ [does _]]]].
  assert (bounded_in k) as bounded
    by (destruct k; auto using axis_position_is_bounded, axis_velocity_is_bounded, axis_torque_is_bounded).
  specialize (bounded _ m _ own shadow). unfold after. rewrite is_next.
  destruct (act (axes (settled c w input) axis) m (axis_config c axis)) as [next reference]. simpl.
  destruct bounded as [b1 [b2 [b3 [b4 [b5 [b6 _]]]]]].
  repeat split; try assumption; try apply b6; rewrite does; assumption.
Qed.

(** What reaches the drive of an axis. *)
Lemma reference_is_clamped : forall c w input w' out axis,
  consistent c w -> one_tick c w input w' out -> (axis < N)%nat ->
  let g := axis_config c axis in
  position (references out axis) =
    clamp (lower g) (upper g) (nominal (axes (server w') axis) + offsets (axes (server w') axis) Position) /\
  lower g <= position (references out axis) <= upper g /\
  nominal (axes (server w') axis) = nominal_of c w input axis.
Proof.
  intros c w input w' out axis is_consistent ticked is_axis g.
  pose proof (settled_is_valid c w input is_consistent) as [_ [are_valid _]].
  destruct (are_valid axis is_axis) as [own [shadow _]].
  pose proof (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [_ [_ [_ [_ acts]]]].
  destruct (acts axis is_axis) as [m [is_next [is_reference [_ [_ [_ is_nominal]]]]]].
  pose proof (axis_position_is_bounded _ m _ own shadow) as bounded.
  rewrite is_next, is_reference.
  destruct (act (axes (settled c w input) axis) m (axis_config c axis)) as [next reference]. simpl.
  destruct bounded as [_ [_ [_ [_ [_ [_ [is_sum [is_inside [is_noted _]]]]]]]]].
  rewrite is_noted. repeat split; try assumption; try apply is_inside; congruence.
Qed.

(** The velocity and torque that are written are the offsets of the axis. *)
Lemma pushes_are_offsets : forall c w input w' out axis,
  consistent c w -> one_tick c w input w' out -> (axis < N)%nat ->
  pushes (references out axis) Velocity = offsets (axes (server w') axis) Velocity /\
  pushes (references out axis) Torque = offsets (axes (server w') axis) Torque.
Proof.
  intros c w input w' out axis is_consistent ticked is_axis.
  pose proof (settled_is_valid c w input is_consistent) as [_ [are_valid _]].
  destruct (are_valid axis is_axis) as [own [shadow _]].
  pose proof (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [_ [_ [_ [_ acts]]]].
  destruct (acts axis is_axis) as [m [is_next [is_reference _]]].
  pose proof (axis_position_is_bounded _ m _ own shadow) as bounded. rewrite is_next, is_reference.
  destruct (act (axes (settled c w input) axis) m (axis_config c axis)) as [next reference]. apply bounded.
Qed.

(** In a tick every offset changes by at most S, and this change by at most A, from what the server
    goes on from; it stays within M; what is written for velocity and torque is the offset. *)
Theorem T1_T2_T3_no_offset_jumps : forall c w input w' out axis k,
  run c w -> one_tick c w input w' out -> (axis < N)%nat ->
  let l := limits (axis_config c axis) k in
  let before := channels (axes (settled c w input) axis) k in
  let after := channels (axes (server w') axis) k in
  Z.abs (count after - count before) <= step_limit l /\
  Z.abs (change after - change before) <= accel l /\ change after = count after - count before /\
  Z.abs (offsets (axes (server w') axis) k) <= largest l /\
  (k = Position \/ pushes (references out axis) k = offsets (axes (server w') axis) k).
Proof.
  intros c w input w' out axis k ran ticked is_axis l before after.
  pose proof (every_state_is_valid c w ran) as ok.
  destruct (channel_is_bounded c w input w' out axis k ok ticked is_axis) as [b1 [b2 [b3 [b4 _]]]].
  destruct (pushes_are_offsets c w input w' out axis ok ticked is_axis) as [velocity torque].
  repeat split; auto. destruct k; auto.
Qed.

(** Over two ticks, if the references before each of them were taken: the second difference of an
    offset is at most A. *)
Theorem T2_over_three_states : forall c w0 i1 w1 o1 i2 w2 o2 axis k,
  run c w0 -> one_tick c w0 i1 w1 o1 -> one_tick c w1 i2 w2 o2 -> fate i1 = Taken -> fate i2 = Taken ->
  (axis < N)%nat ->
  let v w := count (channels (axes (server w) axis) k) in
  Z.abs ((v w2 - v w1) - (v w1 - v w0)) <= accel (limits (axis_config c axis) k).
Proof.
  intros c w0 i1 w1 o1 i2 w2 o2 axis k ran first second taken1 taken2 is_axis v.
  assert (run c w1) as ran1 by (eapply goes_on; eauto).
  pose proof (every_state_is_valid c w0 ran) as [valid0 _].
  pose proof (every_state_is_valid c w1 ran1) as [valid1 _].
  destruct (T1_T2_T3_no_offset_jumps c w0 i1 w1 o1 axis k ran first is_axis) as [_ [_ [change1 _]]].
  destruct (T1_T2_T3_no_offset_jumps c w1 i2 w2 o2 axis k ran1 second is_axis) as [_ [bend [change2 _]]].
  assert (settled c w0 i1 = server w0) as same0.
  { unfold settled. pose proof (all_settle c (server w0) (fate i1) valid0) as [_ [same_0 _]].
    rewrite taken1 in *. exact same_0. }
  assert (settled c w1 i2 = server w1) as same1.
  { unfold settled. pose proof (all_settle c (server w1) (fate i2) valid1) as [_ [same_1 _]].
    rewrite taken2 in *. exact same_1. }
  rewrite same0 in change1. rewrite same1 in change2, bend. unfold v. lia.
Qed.

(** * The drives *)

(** What is in force at the drives is what a server goes on from, or it writes nothing. *)
Lemma goes_on_from_the_drives : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> is_withheld out = false ->
  same (drives w) (demanded (settled c w input)).
Proof.
  intros c w input w' out [is_valid has_taken] ticked is_written.
  pose proof (tick_is_decided c w input w' out is_valid ticked) as [_ [_ [same_withheld _]]].
  destruct ticked as [is_true _].
  unfold settled in *. pose proof (all_settle c (server w) (fate input) is_valid) as [_ [by_fate _]].
  destruct (fate input) as [|found|]; simpl in *.
  - rewrite by_fate. apply has_taken. exact is_true.
  - destruct by_fate as [_ [unknown from_found]].
    assert (~ ~ within_limits c found) as not_unknown.
    { intros not_known. specialize (unknown not_known). congruence. }
    assert (within_limits c found) as is_within.
    { intros i k is_axis. unfold admits.
      destruct (Z_le_dec (Z.abs (offsets_in_force (found i) k)) (largest (limits (axis_config c i) k))); [assumption|].
      exfalso. apply not_unknown. intros all. apply n. exact (all i k is_axis). }
    intros i is_axis. destruct (from_found is_within i is_axis) as [offsets_found [nominal_found _]].
    destruct (is_true i is_axis) as [true_nominal true_offsets]. simpl.
    split; [congruence|]. intros k. rewrite offsets_found. symmetry. apply true_offsets.
  - destruct by_fate as [_ [unknown _]]. congruence.
Qed.

(** A tick that writes, after anything that happened before, changes each offset from the one in
    force at the drive by at most S; and the position from nominal plus offset in force, clamped to the
    travel, by at most the change of the nominal reference plus S. *)
Theorem T21_drives_never_jump : forall c w input w' out axis,
  run c w -> one_tick c w input w' out -> is_withheld out = false -> (axis < N)%nat ->
  let g := axis_config c axis in
  let before := drives w axis in let after := demanded (server w') axis in
  (forall k, Z.abs (offsets_in_force after k - offsets_in_force before k) <= step_limit (limits g k)) /\
  Z.abs (position (references out axis) -
    clamp (lower g) (upper g) (nominal_in_force before + offsets_in_force before Position)) <=
  Z.abs (nominal_in_force after - nominal_in_force before) + step_limit (limits g Position).
Proof.
  intros c w input w' out axis ran ticked is_written is_axis g before after.
  pose proof (every_state_is_valid c w ran) as is_consistent.
  pose proof (a_tick_is_consistent c w input w' out is_consistent ticked) as [[_ [after_valid _]] _].
  pose proof (settled_is_valid c w input is_consistent) as [_ [settled_valid _]].
  pose proof (goes_on_from_the_drives c w input w' out is_consistent ticked is_written axis is_axis)
    as [from_nominal from_offsets].
  assert (forall k, Z.abs (offsets_in_force after k - offsets_in_force before k) <= step_limit (limits g k)) as all.
  { intros k. unfold before, after. rewrite from_offsets. simpl. unfold offsets.
    rewrite (channel_value_is_its_count g), (channel_value_is_its_count g).
    - apply (channel_is_bounded c w input w' out axis k is_consistent ticked is_axis).
    - apply (settled_valid axis is_axis).
    - apply (after_valid axis is_axis). }
  split; [exact all|].
  destruct (reference_is_clamped c w input w' out axis is_consistent ticked is_axis) as [is_sum [is_inside _]].
  specialize (all Position). unfold before, after, g in *. simpl in *. rewrite is_sum in *. unfold clamp in *. lia.
Qed.

(** A tick that writes knows what is in force at the drives, and it is within limits. *)
Theorem T21_unknown_is_not_written : forall c w input w' out,
  run c w -> one_tick c w input w' out -> is_withheld out = false ->
  fate input <> Unknown /\ within_limits c (drives w).
Proof.
  intros c w input w' out ran ticked is_written.
  pose proof (every_state_is_valid c w ran) as is_consistent.
  split.
  { intros unknown. pose proof (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [_ [_ [is_so _]]].
    pose proof (all_settle c (server w) (fate input) (proj1 is_consistent)) as [_ [by_fate _]].
    unfold settled in is_so. rewrite unknown in *. destruct by_fate as [_ [by_fate _]]. congruence. }
  intros i k is_axis.
  pose proof (settled_is_valid c w input is_consistent) as [_ [settled_valid _]].
  destruct (goes_on_from_the_drives c w input w' out is_consistent ticked is_written i is_axis) as [_ from].
  rewrite from. simpl. unfold offsets, admits.
  rewrite (channel_value_is_its_count (axis_config c i)); apply (settled_valid i is_axis).
Qed.

(** A tick that writes a nominal reference further than its limit from the one in force ends in
    Fault: and the machine was read, and the path not off. While the path is off it is not written. *)
Theorem T21_path_is_waited_for : forall c w input w' out axis,
  run c w -> one_tick c w input w' out -> is_withheld out = false -> (axis < N)%nat ->
  nominal_stepped (nominal_in_force (drives w axis)) (nominal_in_force (demanded (server w') axis))
    (axis_config c axis) (cycles (cycle input)) = true ->
  phase (discrete (server w')) = Fault /\
  is_read (cycle input) = true /\ off_path (settled c w input) = false.
Proof.
  intros c w input w' out axis ran ticked is_written is_axis is_far.
  pose proof (every_state_is_valid c w ran) as is_consistent.
  destruct (goes_on_from_the_drives c w input w' out is_consistent ticked is_written axis is_axis) as [from _].
  destruct (reference_is_clamped c w input w' out axis is_consistent ticked is_axis) as [_ [_ to]].
  rewrite from in is_far. simpl in is_far. rewrite to in is_far. unfold nominal_of, stands in is_far.
  destruct (reading (cycle input)) as [read|] eqn:is_reading;
    [|rewrite nominal_that_stands_is_within in is_far; discriminate].
  assert (is_read (cycle input) = true) as was_read by (unfold is_read; rewrite is_reading; reflexivity).
  rewrite was_read in is_far. simpl negb in is_far. rewrite orb_false_l in is_far.
  destruct (off_path (settled c w input) && nominal_fault (facts c w input)) eqn:is_held;
    [rewrite nominal_that_stands_is_within in is_far; discriminate|].
  assert (nominal_fault (facts c w input) = true) as is_fault.
  { simpl. unfold any. apply existsb_exists. exists axis. split; [apply in_seq; lia|].
    unfold has_stepped. rewrite is_reading, is_far. reflexivity. }
  rewrite is_fault, andb_true_r in is_held.
  repeat split; auto.
  destruct (tick_is_decided c w input w' out (proj1 is_consistent) ticked) as [goes_on _].
  rewrite goes_on.
  destruct (decide_stop_leads_to_fault _ (facts c w input) (rules c) (type_config c)
    (settled_discrete c w input is_consistent)) as [stops _].
  apply stops. rewrite is_fault. apply orb_true_r.
Qed.

(** The first tick of a new server whose drives have what it was told, if it writes, moves no nominal
    reference further than its limit. *)
Theorem T21_a_start_waits_for_its_path : forall c told w input w' out axis,
  started c told w -> one_tick c w input w' out -> fate input = Taken -> is_withheld out = false ->
  (axis < N)%nat ->
  nominal_stepped (nominal_in_force (drives w axis)) (nominal_in_force (demanded (server w') axis))
    (axis_config c axis) (cycles (cycle input)) = false.
Proof.
  intros c told w input w' out axis begun ticked taken is_written is_axis.
  destruct (nominal_stepped _ _ _ _) eqn:is_far; [exfalso|reflexivity].
  assert (run c w) as ran by (eapply begins; exact begun).
  destruct (T21_path_is_waited_for c w input w' out axis ran ticked is_written is_axis is_far) as [_ [_ on_path]].
  rewrite (taken_settles_nothing c w input (every_state_is_valid c w ran) taken) in on_path.
  destruct begun as [is_started _]. pose proof (all_start c told) as starts. rewrite is_started in starts.
  destruct starts as [_ [_ [_ [_ [off _]]]]]. congruence.
Qed.

(** A position reference is inside the travel, and moves by at most the change of the nominal
    reference plus S. *)
Theorem T3_reference_moves_no_further : forall c w input w' out axis,
  run c w -> one_tick c w input w' out -> (axis < N)%nat ->
  let g := axis_config c axis in
  let was := settled c w input in
  lower g <= position (references out axis) <= upper g /\
  Z.abs (position (references out axis) -
    clamp (lower g) (upper g) (nominal (axes was axis) + offsets (axes was axis) Position)) <=
  Z.abs (nominal (axes (server w') axis) - nominal (axes was axis)) + step_limit (limits g Position).
Proof.
  intros c w input w' out axis ran ticked is_axis g was.
  pose proof (every_state_is_valid c w ran) as is_consistent.
  pose proof (a_tick_is_consistent c w input w' out is_consistent ticked) as [[_ [after_valid _]] _].
  pose proof (settled_is_valid c w input is_consistent) as [_ [settled_valid _]].
  destruct (reference_is_clamped c w input w' out axis is_consistent ticked is_axis) as [is_sum [is_inside _]].
  split; [exact is_inside|].
  destruct (channel_is_bounded c w input w' out axis Position is_consistent ticked is_axis) as [moved _].
  rewrite is_sum. unfold offsets.
  rewrite (channel_value_is_its_count g); [|apply (after_valid axis is_axis)].
  rewrite (channel_value_is_its_count g); [|apply (settled_valid axis is_axis)].
  unfold clamp, was, g in *. lia.
Qed.

(** * Lost packets *)

(** A tick without a fresh command, and without anything that outranks its miss. *)
Definition misses_one c w input :=
  fate input = Taken /\ outranks_a_miss (facts c w input) = false /\ command (facts c w input) = None.

(** What the row on misses says of a tick of a session that runs. *)
Lemma misses_are_decided : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> fate input = Taken ->
  is_running (discrete (server w)) = true -> outranks_a_miss (facts c w input) = false ->
  let before := discrete (server w) in let after := discrete (server w') in
  let in_a_row := (misses before + skipped (facts c w input))%nat in
  if (2 <=? in_a_row)%nat ||
    (in_a_row =? 1)%nat && (match command (facts c w input) with None => true | _ => false end)
  then phase after = SafeDisconnect /\ action (decision c w input) = Ramp
  else if by_budget (decision c w input) then True
  else is_running after = true /\
    match command (facts c w input) with
    | None => misses after = 1%nat /\ phase after = phase before /\ action (decision c w input) = Hold
    | Some _ => misses after = 0%nat
    end.
Proof.
  intros c w input w' out ok ticked taken runs free.
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  pose proof (settled_discrete c w input ok) as is_valid.
  pose proof (taken_settles_nothing c w input ok taken) as same_server.
  pose proof (decide_second_miss_ends _ (facts c w input) (rules c) (type_config c) is_valid) as decides.
  assert (is_running (discrete (settled c w input)) = true) as runs' by (rewrite same_server; exact runs).
  specialize (decides runs' free). cbv zeta in decides. fold (decision c w input) in decides.
  rewrite <- goes_on, same_server in decides. exact decides.
Qed.

(** Of a session that runs: after two ticks in a row without a fresh command, with references taken
    and nothing that outranks a miss, it is in SafeDisconnect, and every channel took a step of the ramp
    in the second; unless the budget of misses ended it in the first. *)
Theorem T4_second_miss_ramps : forall c w0 i1 w1 o1 i2 w2 o2,
  run c w0 -> one_tick c w0 i1 w1 o1 -> one_tick c w1 i2 w2 o2 ->
  is_running (discrete (server w0)) = true -> is_running (discrete (server w1)) = true ->
  misses_one c w0 i1 -> misses_one c w1 i2 -> by_budget (decision c w0 i1) = false ->
  phase (discrete (server w2)) = SafeDisconnect /\
  forall axis k, (axis < N)%nat -> ramped (limits (axis_config c axis) k)
    (channels (axes (server w1) axis) k) (channels (axes (server w2) axis) k).
Proof.
  intros c w0 i1 w1 o1 i2 w2 o2 ran first second runs0 runs1 [taken1 [free1 none1]] [taken2 [free2 none2]] within.
  assert (run c w1) as ran1 by (eapply goes_on; eauto).
  pose proof (every_state_is_valid c w0 ran) as ok0. pose proof (every_state_is_valid c w1 ran1) as ok1.
  pose proof (misses_are_decided c w0 i1 w1 o1 ok0 first taken1 runs0 free1) as by_first.
  pose proof (misses_are_decided c w1 i2 w2 o2 ok1 second taken2 runs1 free2) as by_second.
  cbv zeta in by_first, by_second. rewrite none1, within in by_first. rewrite none2 in by_second.
  assert (misses (discrete (server w1)) = 1%nat) as missed.
  { destruct ((2 <=? misses (discrete (server w0)) + skipped (facts c w0 i1))%nat ||
      (misses (discrete (server w0)) + skipped (facts c w0 i1) =? 1)%nat && true).
    - destruct by_first as [ended _]. unfold is_running in runs1. rewrite ended in runs1. discriminate.
    - apply by_first. }
  rewrite missed in by_second.
  assert ((2 <=? 1 + skipped (facts c w1 i2))%nat || (1 + skipped (facts c w1 i2) =? 1)%nat && true = true) as two.
  { destruct (skipped (facts c w1 i2)); reflexivity. }
  rewrite two in by_second. destruct by_second as [is_over is_ramp]. split; [exact is_over|].
  intros axis k is_axis. rewrite <- (taken_settles_nothing c w1 i2 ok1 taken2).
  apply (channel_is_bounded c w1 i2 w2 o2 axis k ok1 second is_axis). exact is_ramp.
Qed.

(** Of a session that runs, with no miss counted: a tick without a fresh command holds and changes no
    phase; and with a fresh command in the next tick it runs on, with no miss counted. References are
    taken, no cycle is skipped, nothing outranks a miss, and the budget of misses is not spent. *)
Theorem T4_one_miss_is_tolerated : forall c w0 i1 w1 o1 i2 w2 o2,
  run c w0 -> one_tick c w0 i1 w1 o1 -> one_tick c w1 i2 w2 o2 ->
  is_running (discrete (server w0)) = true -> misses (discrete (server w0)) = 0%nat ->
  misses_one c w0 i1 -> skipped (facts c w0 i1) = 0%nat -> by_budget (decision c w0 i1) = false ->
  fate i2 = Taken -> outranks_a_miss (facts c w1 i2) = false -> command (facts c w1 i2) <> None ->
  skipped (facts c w1 i2) = 0%nat -> by_budget (decision c w1 i2) = false ->
  phase (discrete (server w1)) = phase (discrete (server w0)) /\ action (decision c w0 i1) = Hold /\
  is_running (discrete (server w2)) = true /\ misses (discrete (server w2)) = 0%nat.
Proof.
  intros c w0 i1 w1 o1 i2 w2 o2 ran first second runs0 no_miss [taken1 [free1 none1]] on_time1 within1
    taken2 free2 fresh on_time2 within2.
  assert (run c w1) as ran1 by (eapply goes_on; eauto).
  pose proof (every_state_is_valid c w0 ran) as ok0. pose proof (every_state_is_valid c w1 ran1) as ok1.
  pose proof (misses_are_decided c w0 i1 w1 o1 ok0 first taken1 runs0 free1) as by_first. cbv zeta in by_first.
  rewrite none1, no_miss, on_time1, within1 in by_first. simpl in by_first.
  destruct by_first as [runs1 [missed [same_phase is_hold]]].
  pose proof (misses_are_decided c w1 i2 w2 o2 ok1 second taken2 runs1 free2) as by_second. cbv zeta in by_second.
  rewrite missed, on_time2, within2 in by_second.
  destruct (command (facts c w1 i2)); [|congruence]. simpl in by_second.
  destruct by_second as [runs2 cleared]. repeat split; assumption.
Qed.

(** * The ramp *)

(** In SafeDisconnect and Fault, unless all is at zero and known, every channel of every axis takes
    exactly min(rho, |value|) towards zero, and never past it, under any input. *)
Theorem T5_exact : forall c w input w' out axis k,
  run c w -> one_tick c w input w' out -> is_over (discrete (settled c w input)) = true ->
  all_zero (facts c w input) = false -> (axis < N)%nat ->
  ramped (limits (axis_config c axis) k)
    (channels (axes (settled c w input) axis) k) (channels (axes (server w') axis) k).
Proof.
  intros c w input w' out axis k ran ticked over not_zero is_axis.
  pose proof (every_state_is_valid c w ran) as ok.
  apply (channel_is_bounded c w input w' out axis k ok ticked is_axis).
  pose proof (decide_no_session_ramps _ (facts c w input) (rules c) (type_config c) (settled_discrete c w input ok)) as ramps.
  apply (ramps over not_zero).
Qed.

Lemma over_stays_over : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> is_over (discrete (settled c w input)) = true ->
  all_zero (facts c w input) = false -> is_over (discrete (server w')) = true.
Proof.
  intros c w input w' out ok ticked over not_zero.
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _]. rewrite goes_on.
  pose proof (settled_discrete c w input ok) as is_valid.
  pose proof (decide_no_session_ramps _ (facts c w input) (rules c) (type_config c) is_valid) as ramps.
  destruct (decide_authority_needs_zero _ (facts c w input) (rules c) (type_config c) is_valid) as [_ needs_zero].
  destruct (ramps over not_zero) as [_ not_live].
  destruct (live_or_over (next (decision c w input))) as [live | [is_so | listens]];
    [unfold decision in live; congruence | exact is_so |].
  assert (all_zero (facts c w input) = true); [|congruence].
  apply needs_zero; [exact listens|].
  unfold is_over in over. destruct (phase (discrete (settled c w input))); discriminate.
Qed.

(** Of every tick of a run: something that may depend on where it begins. *)
Fixpoint all_ticks c (holds_at : World -> Input -> Prop) w (inputs : list Input) last : Prop :=
  match inputs with
  | nil => w = last
  | input :: rest => holds_at w input /\ exists w' out,
      one_tick c w input w' out /\ all_ticks c holds_at w' rest last
  end.

Lemma ramped_lowers : forall l before after bound, 0 <= bound ->
  ramped l before after -> Z.abs (count before) <= bound -> Z.abs (count after) <= Z.max 0 (bound - rho l).
Proof. intros l before after bound positive [is_exact _] below. lia. Qed.

(** From SafeDisconnect or Fault on, after n ticks whose references are taken and of which none begins
    with all at zero, |value| has fallen by n rho, or is zero: it is zero if that is |value| or more. *)
Theorem T5_ramp_ends : forall c inputs w last,
  run c w -> is_over (discrete (server w)) = true ->
  all_ticks c (fun w input => fate input = Taken /\ all_zero (facts c w input) = false) w inputs last ->
  forall axis k, (axis < N)%nat ->
  let first := count (channels (axes (server w) axis) k) in
  let now := count (channels (axes (server last) axis) k) in
  let fallen := Z.of_nat (length inputs) * rho (limits (axis_config c axis) k) in
  Z.abs now <= Z.max 0 (Z.abs first - fallen) /\ (Z.abs first <= fallen -> now = 0).
Proof.
  intros c inputs w last ran over all axis k is_axis first now fallen.
  enough (Z.abs now <= Z.max 0 (Z.abs first - fallen)) by lia.
  subst first now fallen. revert w last ran over all.
  induction inputs as [|input rest rests]; intros w last ran over all.
  - simpl in all. subst last. simpl. lia.
  - destruct all as [[taken not_zero] [w' [out [ticked all]]]].
    pose proof (every_state_is_valid c w ran) as ok.
    pose proof (taken_settles_nothing c w input ok taken) as same_server.
    assert (is_over (discrete (server w')) = true) as over'.
    { apply (over_stays_over c w input w' out ok ticked); [rewrite same_server; exact over | exact not_zero]. }
    assert (run c w') as ran' by (eapply goes_on; eauto).
    specialize (rests w' last ran' over' all).
    assert (is_over (discrete (settled c w input)) = true) as over0 by (rewrite same_server; exact over).
    pose proof (T5_exact c w input w' out axis k ran ticked over0 not_zero is_axis) as [is_exact _].
    rewrite same_server in is_exact.
    destruct (type_limits (axis_config c axis) k) as [_ falls].
    simpl length. rewrite Nat2Z.inj_succ. nia.
Qed.

(** * Who may command *)

(** A session begins only in Listening, for who asked, and while every offset in force at the drives,
    and every channel, is zero. *)
Theorem T6_T21_granted_at_zero : forall c w input w' out,
  run c w -> one_tick c w input w' out ->
  is_live (discrete (settled c w input)) = false -> is_live (discrete (server w')) = true ->
  phase (discrete (settled c w input)) = Listening /\
  (exists from, hello (facts c w input) = Some (from, epoch (discrete (server w'))) /\
    owner (discrete (server w')) = Some from) /\
  forall axis k, (axis < N)%nat ->
    offsets_in_force (drives w axis) k = 0 /\
    at_zero (channels (axes (settled c w input) axis) k) /\ at_zero (channels (axes (server w') axis) k).
Proof.
  intros c w input w' out ran ticked was_not is_so.
  pose proof (every_state_is_valid c w ran) as ok.
  pose proof (settled_is_valid c w input ok) as [discrete_ok [axes_ok withheld_ok]].
  pose proof (a_tick_is_consistent c w input w' out ok ticked) as [[_ [after_ok _]] _].
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on [_ [out_withheld _]]].
  destruct (decide_authority_needs_zero _ (facts c w input) (rules c) (type_config c) discrete_ok) as [granted _].
  rewrite goes_on in is_so. destruct (granted is_so was_not) as [listened [shakes [from [asked owns]]]].
  split; [exact listened|]. split; [exists from; rewrite goes_on; split; assumption|].
  intros axis k is_axis.
  destruct (axes_ok axis is_axis) as [own [_ [rests _]]].
  destruct (after_ok axis is_axis) as [_ [_ [rests' _]]].
  assert (at_zero (channels (axes (settled c w input) axis) k)) as zero by (apply rests; auto).
  assert (is_withheld out = false) as is_written.
  { rewrite out_withheld. destruct (withheld (settled c w input)) eqn:E; auto.
    specialize (withheld_ok eq_refl). unfold is_over in withheld_ok. rewrite listened in withheld_ok. discriminate. }
  destruct (goes_on_from_the_drives c w input w' out ok ticked is_written axis is_axis) as [_ from_drives].
  repeat split; try apply zero.
  - rewrite from_drives. simpl. unfold offsets. rewrite (channel_value_is_its_count (axis_config c axis)); [apply zero | apply own].
  - apply rests'. right. left. rewrite goes_on. exact shakes.
  - apply rests'. right. left. rewrite goes_on. exact shakes.
Qed.

(** * A stop *)

Lemma fault_stays : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> phase (discrete (server w)) = Fault ->
  at_rearm (cycle input) && rearm_released (discrete (server w)) = false ->
  phase (discrete (server w')) = Fault /\
  rearm_released (discrete (server w')) = rearm_released (discrete (server w)) || negb (at_rearm (cycle input)).
Proof.
  intros c w input w' out ok ticked faulty stuck.
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  destruct (decide_stop_leads_to_fault _ (facts c w input) (rules c) (type_config c) (settled_discrete c w input ok))
    as [stops [released stays]].
  pose proof (all_settle c (server w) (fate input) (proj1 ok)) as [_ [by_fate [_ [_ kept]]]].
  fold (settled c w input) in by_fate, kept.
  assert (phase (next (decision c w input)) = Fault) as still.
  { destruct (fate input) eqn:is_fate.
    - apply stays; [rewrite by_fate; exact faulty|]. rewrite kept. simpl. rewrite stuck. reflexivity.
    - apply stops. simpl. unfold refused. rewrite is_fate. rewrite orb_true_r. reflexivity.
    - apply stops. simpl. unfold refused. rewrite is_fate. rewrite orb_true_r. reflexivity. }
  split; rewrite goes_on; [exact still|].
  unfold decision in *. rewrite released, still, kept. reflexivity.
Qed.

(** A stop (heard, at the machine, a machine that is not read, a write that was not taken), an end and a
    fault of the path: every channel takes a step of the ramp in that tick, and Fault lasts from then on
    for as long as re-arm is not pressed. *)
Theorem T9_a_stop_is_not_forgotten : forall c w input w' out rest last,
  run c w -> one_tick c w input w' out ->
  stop (facts c w input) || quit (facts c w input) || nominal_fault (facts c w input) = true ->
  all_ticks c (fun _ input => at_rearm (cycle input) = false) w' rest last ->
  (forall axis k, (axis < N)%nat -> ramped (limits (axis_config c axis) k)
    (channels (axes (settled c w input) axis) k) (channels (axes (server w') axis) k)) /\
  phase (discrete (server last)) = Fault.
Proof.
  intros c w input w' out rest last ran ticked stopped all.
  pose proof (every_state_is_valid c w ran) as ok.
  destruct (decide_stop_leads_to_fault _ (facts c w input) (rules c) (type_config c) (settled_discrete c w input ok))
    as [stops _].
  destruct (stops stopped) as [faulty is_ramp].
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  split.
  - intros axis k is_axis. apply (channel_is_bounded c w input w' out axis k ok ticked is_axis). exact is_ramp.
  - assert (consistent c w') as ok' by (eapply a_tick_is_consistent; eauto).
    assert (phase (discrete (server w')) = Fault) as faulty' by (rewrite goes_on; exact faulty).
    clear - ok' faulty' all axes_are_three_or_six. revert w' ok' faulty' all.
    induction rest as [|next_input rest rests]; intros w' ok' faulty' all; simpl in all.
    + subst. exact faulty'.
    + destruct all as [released [w'' [out [ticked all]]]].
      apply (rests w''); auto.
      * eapply a_tick_is_consistent; eauto.
      * apply (fault_stays c w' next_input w'' out ok' ticked faulty'). rewrite released. reflexivity.
Qed.

(** A server that starts with a latched stop is in Fault for as long as re-arm is not pressed. *)
Theorem T9_latch_outlives_the_server : forall c told w rest last,
  started c told w -> stop_latched told = true ->
  all_ticks c (fun _ input => at_rearm (cycle input) = false) w rest last ->
  phase (discrete (server last)) = Fault.
Proof.
  intros c told w rest last begun latch all.
  pose proof (a_start_is_consistent c told w begun) as ok.
  assert (phase (discrete (server w)) = Fault) as faulty.
  { destruct begun as [is_started _]. pose proof (all_start c told) as starts. rewrite is_started in starts. tauto. }
  clear begun. revert w ok faulty all.
  induction rest as [|input rest rests]; intros w ok faulty all; simpl in all.
  - subst. exact faulty.
  - destruct all as [released [w' [out [ticked all]]]].
    apply (rests w'); auto.
    + eapply a_tick_is_consistent; eauto.
    + apply (fault_stays c w input w' out ok ticked faulty). rewrite released. reflexivity.
Qed.

(** A server that starts with a latched stop, and whose re-arm is pressed in every tick, stays in
    Fault. *)
Theorem T9_a_stuck_rearm_leads_nowhere : forall c told w rest last,
  started c told w -> stop_latched told = true ->
  all_ticks c (fun _ input => at_rearm (cycle input) = true) w rest last ->
  phase (discrete (server last)) = Fault.
Proof.
  intros c told w rest last begun latch all.
  pose proof (a_start_is_consistent c told w begun) as ok.
  assert (phase (discrete (server w)) = Fault /\ rearm_released (discrete (server w)) = false) as [faulty stuck].
  { destruct begun as [is_started _]. pose proof (all_start c told) as starts. rewrite is_started in starts. tauto. }
  clear begun. revert w ok faulty stuck all.
  induction rest as [|input rest rests]; intros w ok faulty stuck all; simpl in all.
  - subst. exact faulty.
  - destruct all as [pressed [w' [out [ticked all]]]].
    destruct (fault_stays c w input w' out ok ticked faulty) as [faulty' released'];
      [rewrite stuck; apply andb_false_r|].
    apply (rests w'); auto.
    + eapply a_tick_is_consistent; eauto.
    + rewrite released', stuck, pressed. reflexivity.
Qed.

(** * Silence *)

(** A tick in which everything works, and nothing arrives. *)
Definition hears_nothing c w input :=
  fate input = Taken /\ events input = nil /\ is_read (cycle input) = true /\
  at_stop (cycle input) = false /\ at_quit (cycle input) = false /\ at_rearm (cycle input) = false /\
  (elapsed (cycle input) <= 1)%nat /\ nominal_fault (facts c w input) = false.

Lemma silence : forall c w input, hears_nothing c w input ->
  facts c w input = {| stop := false; quit := false; rearm := false; nominal_fault := false;
    framing := false; flood := false; closed := false; goodbye := false;
    agitated := agitated (facts c w input); command := None; hello := None; skipped := 0;
    all_zero := all_zero (facts c w input) |}.
Proof.
  intros c w input [taken [silent [was_read [no_stop [no_quit [no_rearm [on_time on_path]]]]]]].
  assert (heard c w input = nothing) as nothing_heard
    by (unfold heard; rewrite silent, read_classify_is_one_by_one; reflexivity).
  unfold facts in *. rewrite nothing_heard in *. unfold complete in *. cbn -[any every cycles Nat.sub] in *.
  rewrite on_path, no_stop, no_quit, no_rearm, was_read. unfold refused. rewrite taken.
  assert (cycles (cycle input) - 1 = 0)%nat as none by (unfold cycles; lia). rewrite none. reflexivity.
Qed.

(** What the row on silence says of such a tick. *)
Lemma silence_decides : forall c w input w' out,
  consistent c w -> one_tick c w input w' out -> hears_nothing c w input ->
  let d := decision c w input in
  discrete (server w') = next d /\ settled c w input = server w /\ withheld (server w) = false /\
  let over := phase (next d) = SafeDisconnect /\ action d = Ramp in
  match phase (discrete (server w)) with
  | Listening => phase (next d) = Listening
  | Handshake => phase (next d) = Handshake /\ waited (next d) = S (waited (discrete (server w))) \/ over
  | Submit | Obtain => misses (discrete (server w)) = 0%nat /\ misses (next d) = 1%nat /\
      phase (next d) = phase (discrete (server w)) \/ over
  | SafeDisconnect => if all_zero (facts c w input) then phase (next d) = Listening else over
  | Fault => True
  end.
Proof.
  intros c w input w' out ok ticked silent d.
  pose proof (taken_settles_nothing c w input ok (proj1 silent)) as same_server.
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  split; [exact goes_on|]. split; [exact same_server|]. split.
  { destruct ok as [_ took_it]. apply took_it. destruct ticked as [truth _]. rewrite (proj1 silent) in truth. exact truth. }
  pose proof (settled_discrete c w input ok) as is_valid.
  pose proof (decide_silence_leads_to_listening _ (all_zero (facts c w input)) (agitated (facts c w input)) (rules c)
    (type_config c) is_valid) as silently.
  cbv zeta in silently. rewrite <- (silence c w input silent) in silently.
  fold (decision c w input) in silently. fold d in silently. rewrite same_server in silently. exact silently.
Qed.

Lemma listens_on : forall c inputs w last,
  consistent c w -> phase (discrete (server w)) = Listening -> all_ticks c (hears_nothing c) w inputs last ->
  phase (discrete (server last)) = Listening.
Proof.
  intros c inputs. induction inputs as [|input rest rests]; intros w last ok listens all; simpl in all.
  - subst. exact listens.
  - destruct all as [silent [w' [out [ticked all]]]].
    apply (rests w' last); auto; [eapply a_tick_is_consistent; eauto|].
    destruct (silence_decides c w input w' out ok ticked silent) as [goes_on [_ [_ says]]].
    rewrite listens in says. rewrite goes_on. exact says.
Qed.

(** Every channel is within a bound, less some ramp steps. *)
Definition within_steps c w bound steps := forall axis k, (axis < N)%nat ->
  Z.abs (count (channels (axes (server w) axis) k)) <=
  Z.max 0 (bound axis k - Z.of_nat steps * rho (limits (axis_config c axis) k)).
Definition enough c bound steps := forall axis k, (axis < N)%nat ->
  bound axis k <= Z.of_nat steps * rho (limits (axis_config c axis) k).

Lemma zero_is_seen : forall c w input, consistent c w -> hears_nothing c w input ->
  settled c w input = server w -> withheld (server w) = false ->
  (forall axis k, (axis < N)%nat -> count (channels (axes (server w) axis) k) = 0) ->
  all_zero (facts c w input) = true.
Proof.
  intros c w input [[_ [are_valid _]] _] _ same_server may_write zero.
  unfold facts. rewrite same_server. simpl. rewrite may_write. simpl. unfold every. apply forallb_forall.
  intros axis within. apply in_seq in within.
  assert (axis < N)%nat as is_axis by lia. destruct (are_valid axis is_axis) as [own _].
  assert (forall k, offsets (axes (server w) axis) k =? 0 = true) as all.
  { intros k. unfold offsets. rewrite (channel_value_is_its_count _ _ _ (own k)), zero by assumption. reflexivity. }
  unfold is_at_zero, all_kinds. rewrite !all. reflexivity.
Qed.

Lemma ramp_lowers : forall c w input w' out bound steps,
  consistent c w -> one_tick c w input w' out -> settled c w input = server w ->
  action (decision c w input) = Ramp -> within_steps c w bound steps -> within_steps c w' bound (S steps).
Proof.
  intros c w input w' out bound steps ok ticked same_server is_ramp within axis k is_axis.
  set (l := limits (axis_config c axis) k).
  destruct (channel_is_bounded c w input w' out axis k ok ticked is_axis) as [_ [_ [_ [_ ramps]]]].
  specialize (ramps is_ramp). rewrite same_server in ramps.
  pose proof (ramped_lowers l _ _ _ (Z.le_max_l 0 _) ramps (within axis k is_axis)) as lowered.
  destruct (type_limits (axis_config c axis) k) as [_ falls]. fold l in falls, lowered. nia.
Qed.

Lemma silent_ramp_listens : forall c bound limit inputs w last steps,
  enough c bound limit -> consistent c w -> phase (discrete (server w)) = SafeDisconnect ->
  within_steps c w bound steps ->
  (limit - steps + 1 <= length inputs)%nat -> all_ticks c (hears_nothing c) w inputs last ->
  phase (discrete (server last)) = Listening.
Proof.
  intros c bound limit inputs. induction inputs as [|input rest rests];
    intros w last steps is_enough ok over within long all; simpl in all, long; [lia|].
  destruct all as [silent [w' [out [ticked all]]]].
  pose proof (a_tick_is_consistent c w input w' out ok ticked) as ok'.
  destruct (silence_decides c w input w' out ok ticked silent) as [goes_on [same_server [may_write says]]].
  rewrite over in says.
  destruct (all_zero (facts c w input)) eqn:zero.
  - apply (listens_on c rest w' last ok'); [rewrite goes_on; exact says | exact all].
  - destruct says as [over' is_ramp].
    apply (rests w' last (S steps)); auto.
    + rewrite goes_on. exact over'.
    + apply (ramp_lowers c w input w' out bound steps); auto.
    + destruct (le_lt_dec limit steps) as [is_done|]; [exfalso|lia].
      assert (all_zero (facts c w input) = true); [|congruence].
      apply zero_is_seen; auto. intros axis k is_axis.
      specialize (within axis k is_axis). specialize (is_enough axis k is_axis).
      destruct (type_limits (axis_config c axis) k) as [_ falls]. nia.
Qed.

(** If every tick hears nothing, a session that runs is in Listening after 2 ticks and as many steps,
    at least 1, as rho of every channel needs to cover its M; and stays there. *)
Theorem T22_silence_ends_in_listening : forall c inputs w last steps,
  run c w -> is_running (discrete (server w)) = true ->
  enough c (fun axis k => largest (limits (axis_config c axis) k)) steps ->
  (1 <= steps)%nat -> (2 + steps <= length inputs)%nat ->
  all_ticks c (hears_nothing c) w inputs last -> phase (discrete (server last)) = Listening.
Proof.
  intros c inputs w last steps ran runs is_enough some long all.
  pose proof (every_state_is_valid c w ran) as ok.
  (* A tick of silence of a session that runs is its first, or the ramp has begun. *)
  assert (forall w input w' out, consistent c w -> one_tick c w input w' out -> hears_nothing c w input ->
    is_running (discrete (server w)) = true ->
    misses (discrete (server w)) = 0%nat /\ is_running (discrete (server w')) = true /\
      misses (discrete (server w')) = 1%nat \/
    phase (discrete (server w')) = SafeDisconnect /\
      within_steps c w' (fun axis k => largest (limits (axis_config c axis) k)) 1) as one.
  { clear - axes_are_three_or_six. intros w input w' out ok ticked silent runs.
    destruct (silence_decides c w input w' out ok ticked silent) as [goes_on [same_server [_ says]]].
    assert (misses (discrete (server w)) = 0%nat /\ misses (next (decision c w input)) = 1%nat /\
        phase (next (decision c w input)) = phase (discrete (server w)) \/
      phase (next (decision c w input)) = SafeDisconnect /\ action (decision c w input) = Ramp) as said
      by (unfold is_running in runs; destruct (phase (discrete (server w))); try discriminate; exact says).
    destruct said as [[none [first same_phase]] | [over is_ramp]].
    - left. rewrite goes_on. unfold is_running in *. rewrite same_phase. auto.
    - right. rewrite goes_on. split; [exact over|].
      apply (ramp_lowers c w input w' out _ 0 ok ticked same_server is_ramp).
      intros axis k is_axis. destruct ok as [[_ [are_valid _]] _].
      destruct (are_valid axis is_axis) as [own _]. destruct (own k) as [within _].
      simpl. lia. }
  destruct inputs as [|i1 inputs]; simpl in long; [lia|].
  destruct all as [silent1 [w1 [o1 [ticked1 all]]]].
  pose proof (a_tick_is_consistent c w i1 w1 o1 ok ticked1) as ok1.
  destruct (one w i1 w1 o1 ok ticked1 silent1 runs) as [[_ [runs1 missed]] | [over within]];
    [|eapply (silent_ramp_listens c _ steps inputs w1 last 1); eauto; lia].
  destruct inputs as [|i2 inputs]; simpl in long; [lia|].
  destruct all as [silent2 [w2 [o2 [ticked2 all]]]].
  pose proof (a_tick_is_consistent c w1 i2 w2 o2 ok1 ticked2) as ok2.
  destruct (one w1 i2 w2 o2 ok1 ticked2 silent2 runs1) as [[none _] | [over within]]; [congruence|].
  eapply (silent_ramp_listens c _ steps inputs w2 last 1); eauto; lia.
Qed.

(** If every tick hears nothing, a session that waits for its first command is in Listening after the
    ticks of the handshake, and one; and stays there. *)
Theorem T22_handshake_ends_in_listening : forall c inputs w last,
  run c w -> phase (discrete (server w)) = Handshake ->
  (handshake_ticks (rules c) + 1 <= length inputs)%nat ->
  all_ticks c (hears_nothing c) w inputs last -> phase (discrete (server last)) = Listening.
Proof.
  intros c inputs w last ran shakes long all.
  pose proof (every_state_is_valid c w ran) as ok.
  assert (handshake_ticks (rules c) - waited (discrete (server w)) + 1 <= length inputs)%nat as left by lia.
  clear ran long. revert w ok shakes left all.
  induction inputs as [|input rest rests]; intros w ok shakes left all; simpl in all, left; [lia|].
  destruct all as [silent [w' [out [ticked all]]]].
  pose proof (a_tick_is_consistent c w input w' out ok ticked) as ok'.
  destruct (silence_decides c w input w' out ok ticked silent) as [goes_on [same_server [may_write says]]].
  rewrite shakes in says.
  pose proof ok as [[[_ [_ [waits _]]] [axes_ok _]] _]. rewrite shakes in waits. destruct waits as [waits _].
  destruct says as [[still waits'] | [over is_ramp]].
  - apply (rests w' ok'); [rewrite goes_on; exact still | rewrite goes_on, waits'; lia | exact all].
  - (* It rests at zero, and listens in the next tick. *)
    assert (forall axis k, (axis < N)%nat -> count (channels (axes (server w') axis) k) = 0) as zero.
    { intros axis k is_axis.
      destruct (channel_is_bounded c w input w' out axis k ok ticked is_axis) as [_ [_ [_ [_ ramps]]]].
      destruct (ramps is_ramp) as [is_exact _]. rewrite same_server in is_exact.
      destruct (axes_ok axis is_axis) as [_ [_ [rests_at_zero _]]].
      rewrite shakes in rests_at_zero. destruct (rests_at_zero (or_intror (or_introl eq_refl)) k) as [zero _].
      rewrite zero in is_exact. destruct (type_limits (axis_config c axis) k) as [_ falls]. lia. }
    apply (silent_ramp_listens c (fun _ _ => 0) 0 rest w' last 1); auto.
    + intros axis k is_axis. lia.
    + rewrite goes_on. exact over.
    + intros axis k is_axis. rewrite zero by assumption. lia.
    + lia.
Qed.

(** * The owner *)

Definition is_owners s (event : nat * Event) :=
  match owner (discrete s) with Some who => (fst event =? who)%nat | None => false end.

Lemma others_are_not_heard : N = 3%nat -> forall c s epochs events, valid c s ->
  phase (discrete s) <> Listening ->
  classify c s epochs (filter (is_owners s) events) = classify c s epochs events.
Proof.
  intros three c s epochs events is_valid active. rewrite 2!read_classify_is_one_by_one. generalize nothing.
  induction events as [|[from event] rest rests]; intros a; [reflexivity|].
  cbn [filter]. destruct (is_owners s (from, event)) eqn:is_his; cbn [fold_left]; [apply rests|].
  rewrite rests. f_equal. symmetry.
  apply sift_only_the_owner_decides; auto. intros owns. unfold is_owners in is_his. rewrite owns in is_his.
  simpl in is_his. rewrite Nat.eqb_refl in is_his. discriminate.
Qed.

(** Outside Listening, what others than the owner send decides nothing: in a tick without it the server
    decides the same, every axis does the same, and the same is written. *)
Theorem T7_others_decide_nothing : N = 3%nat -> forall c w input,
  run c w -> phase (discrete (settled c w input)) <> Listening ->
  let after events := tick c (server w) (fate input) events (epochs input) (cycle input) in
  let (all, out) := after (events input) in
  let (of_owner, out') := after (filter (is_owners (settled c w input)) (events input)) in
  discrete of_owner = discrete all /\ withheld of_owner = withheld all /\ off_path of_owner = off_path all /\
  is_withheld out' = is_withheld out /\
  forall axis, (axis < N)%nat ->
    axes of_owner axis = axes all axis /\ references out' axis = references out axis.
Proof.
  intros three c w input ran active.
  pose proof (every_state_is_valid c w ran) as ok. pose proof (settled_is_valid c w input ok) as is_settled.
  pose proof (session_tick_is_its_parts three c (server w) (fate input) (events input) (epochs input)
    (cycle input) (proj1 ok)) as of_all.
  pose proof (session_tick_is_its_parts three c (server w) (fate input)
    (filter (is_owners (settled c w input)) (events input)) (epochs input) (cycle input) (proj1 ok)) as of_his.
  cbv beta zeta in of_all, of_his |- *. fold (settled c w input) in of_all, of_his.
  rewrite (others_are_not_heard three c _ _ _ is_settled active) in of_his.
  destruct (tick _ _ _ (events input) _ _) as [all out].
  destruct (tick _ _ _ (filter _ _) _ _) as [of_owner out'].
  destruct (step _ _ _ _ _) as [stepped of_step].
  destruct of_all as [all_1 [all_2 [all_3 [all_4 all_5]]]]. destruct of_his as [his_1 [his_2 [his_3 [his_4 his_5]]]].
  split; [congruence|]. split; [congruence|]. split; [congruence|]. split; [congruence|].
  intros axis is_axis. destruct (all_2 axis is_axis). destruct (his_2 axis is_axis). split; congruence.
Qed.

(** What arrives: a datagram at a connection as it is then, or any other event. *)
Inductive Arrival := OverDatagrams (door : Door) (bytes : Bytes) | Otherwise (event : Event).
Definition event_of arrival :=
  match arrival with OverDatagrams door bytes => take door bytes | Otherwise event => Some event end.
Definition events_of (arrivals : list (nat * Arrival)) :=
  flat_map (fun '(from, arrival) => match event_of arrival with Some event => (from, event) :: nil | None => nil end) arrivals.
Definition is_forged arrival :=
  match arrival with OverDatagrams door bytes => is_authentic door bytes = false | Otherwise _ => False end.

(** Outside Listening, datagrams at the owner's connection that are not authentic at its door decide
    nothing, beside any events of others: the tick is as if nothing had arrived. *)
Theorem T27_forgeries_decide_nothing : N = 3%nat -> forall c w input arrivals,
  run c w -> phase (discrete (settled c w input)) <> Listening -> events input = events_of arrivals ->
  (forall from arrival, In (from, arrival) arrivals ->
    owner (discrete (settled c w input)) = Some from -> is_forged arrival) ->
  let after events := tick c (server w) (fate input) events (epochs input) (cycle input) in
  let (all, out) := after (events input) in
  let (of_none, out') := after nil in
  discrete of_none = discrete all /\ withheld of_none = withheld all /\ off_path of_none = off_path all /\
  is_withheld out' = is_withheld out /\
  forall axis, (axis < N)%nat ->
    axes of_none axis = axes all axis /\ references out' axis = references out axis.
Proof.
  intros three c w input arrivals ran active arrived forged.
  assert (filter (is_owners (settled c w input)) (events input) = nil) as nothing_heard.
  { rewrite arrived. unfold events_of. clear arrived. induction arrivals as [|[from arrival] rest rests]; [reflexivity|].
    cbn [flat_map]. rewrite filter_app, rests by (intros; eapply forged; [right|]; eassumption).
    rewrite app_nil_r. destruct (event_of arrival) as [event|] eqn:is_heard; [cbn [filter]|reflexivity].
    destruct (is_owners (settled c w input) (from, event)) eqn:is_his; [exfalso|reflexivity].
    unfold is_owners in is_his. destruct (owner (discrete (settled c w input))) as [who|] eqn:owns; [|discriminate].
    apply Nat.eqb_eq in is_his. simpl in is_his. subst who.
    specialize (forged from arrival (or_introl eq_refl) eq_refl).
    destruct arrival as [door bytes|]; [|exact forged].
    simpl in is_heard, forged. rewrite slot_forgery_is_nothing in is_heard by assumption. discriminate. }
  rewrite <- nothing_heard. exact (T7_others_decide_nothing three c w input ran active).
Qed.

(** * Epochs and sequences *)

Lemma heard_is_new : N = 3%nat -> forall c w input, consistent c w ->
  is_new (discrete (settled c w input)) (facts c w input).
Proof.
  intros three c w input ok.
  assert (is_new (discrete (settled c w input)) (asked (heard c w input))) as is_so; [|exact is_so].
  unfold heard. rewrite read_classify_is_one_by_one.
  assert (is_new (discrete (settled c w input)) (asked nothing)) as first by (split; simpl; discriminate).
  revert first. generalize nothing. induction (events input) as [|event rest rests]; intros a first; simpl.
  - exact first.
  - apply rests. apply sift_accepts_only_what_is_new; auto using settled_is_valid.
Qed.

(** In a tick the epoch does not fall, and rises if a session begins; while it stays, the accepted
    sequence does not fall, and rises if the command is followed. *)
Theorem T23_epochs_never_repeat : N = 3%nat -> forall c w input w' out,
  run c w -> one_tick c w input w' out ->
  let before := discrete (server w) in let after := discrete (server w') in
  (epoch before <= epoch after)%nat /\
  (is_live (discrete (settled c w input)) = false -> is_live after = true -> (epoch before < epoch after)%nat) /\
  (epoch after = epoch before -> (accepted before <= accepted after)%nat) /\
  (epoch after = epoch before -> action (decision c w input) = Follow \/ action (decision c w input) = FollowZero ->
    (accepted before < accepted after)%nat).
Proof.
  intros three c w input w' out ran ticked before after.
  pose proof (every_state_is_valid c w ran) as ok.
  pose proof (settled_discrete c w input ok) as is_valid.
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  pose proof (all_settle c (server w) (fate input) (proj1 ok)) as [_ [_ [same_epoch [same_sequence _]]]].
  fold (settled c w input) in same_epoch, same_sequence. fold before in same_epoch, same_sequence.
  pose proof (decide_epochs_and_sequences_rise _ (facts c w input) (rules c) (type_config c) is_valid
    (heard_is_new three c w input ok)) as rises.
  cbv zeta in rises. fold (decision c w input) in rises. rewrite <- goes_on in rises. fold after in rises.
  rewrite same_epoch, same_sequence in rises.
  destruct (decide_authority_needs_zero _ (facts c w input) (rules c) (type_config c) is_valid) as [granted _].
  fold (decision c w input) in granted. rewrite <- goes_on in granted. fold after in granted.
  destruct (epoch after =? epoch before)%nat eqn:is_same.
  - apply Nat.eqb_eq in is_same. destruct rises as [shakes [rises acts]].
    repeat split; auto; [lia|]. intros was_not is_so. exfalso.
    destruct (granted is_so was_not) as [listened [now_shakes _]]. rewrite (shakes now_shakes) in listened. discriminate.
  - apply Nat.eqb_neq in is_same. destruct rises as [rises _]. repeat split; try lia.
Qed.

Lemma epochs_and_sequences_rise : N = 3%nat -> forall c inputs w last,
  run c w -> all_ticks c (fun _ _ => True) w inputs last ->
  let before := discrete (server w) in let after := discrete (server last) in
  run c last /\ (epoch before <= epoch after)%nat /\
  (epoch after = epoch before -> (accepted before <= accepted after)%nat).
Proof.
  intros three c inputs. induction inputs as [|input rest rests]; intros w last ran all before after.
  - simpl in all. subst last. repeat split; auto.
  - destruct all as [_ [w' [out [ticked all]]]].
    destruct (T23_epochs_never_repeat three c w input w' out ran ticked) as [rises [_ [counts _]]].
    destruct (rests w' last (goes_on c w input w' out ran ticked) all) as [runs [rises' counts']].
    fold before in rises, counts. fold after in rises', counts'.
    repeat split; [exact runs | lia | intros same_epoch].
    etransitivity; [apply counts | apply counts']; lia.
Qed.

(** What a tick has accepted is not accepted again, however many ticks later: a command of the same
    epoch has a higher sequence, and a Hello is for a higher epoch. *)
Theorem T23_a_recorded_frame_acts_no_more : N = 3%nat -> forall c inputs w last later,
  run c w -> all_ticks c (fun _ _ => True) w inputs last ->
  let before := discrete (server w) in
  (epoch (discrete (server last)) = epoch before -> forall sequence mode,
    command (facts c last later) = Some (sequence, mode) -> (accepted before < sequence)%nat) /\
  (forall from granted, hello (facts c last later) = Some (from, granted) -> (epoch before < granted)%nat).
Proof.
  intros three c inputs w last later ran all before.
  destruct (epochs_and_sequences_rise three c inputs w last ran all) as [runs [rises counts]].
  fold before in rises, counts. pose proof (every_state_is_valid c last runs) as ok.
  destruct (heard_is_new three c last later ok) as [is_new_hello is_new_command].
  pose proof (all_settle c (server last) (fate later) (proj1 ok)) as [_ [_ [same_epoch [same_sequence _]]]].
  fold (settled c last later) in same_epoch, same_sequence.
  split.
  - intros same_session sequence mode is_command. specialize (counts same_session).
    pose proof (is_new_command sequence mode is_command). lia.
  - intros from granted is_hello. pose proof (is_new_hello from granted is_hello). lia.
Qed.

(** * Agitation *)

(** Ticks that each end in Obtain, from one without agitation of an axis on; their number, and the sum
    of the second differences of its position offset. *)
Inductive obtains_for c axis : World -> nat -> Z -> World -> Prop :=
| at_first w : agitation (axes (server w) axis) = 0 -> obtains_for c axis w 0%nat 0 w
| and_then w0 n sum w input w' out :
    obtains_for c axis w0 n sum w -> one_tick c w input w' out -> fate input = Taken ->
    phase (discrete (server w')) = Obtain ->
    obtains_for c axis w0 (S n)
      (sum + Z.abs (change (channels (axes (server w') axis) Position) -
        change (channels (axes (server w) axis) Position))) w'.

(** Over n ticks of Obtain whose references are taken, from a sum of zero on, the second differences of
    the position offset sum up to at most B + r n, with B a thousand times r, if the axis is not beyond
    its budget after them. *)
Theorem T33_agitation_is_bounded : forall c axis w0 n sum w r,
  run c w0 -> (axis < N)%nat -> obtains_for c axis w0 n sum w ->
  refill (axis_config c axis) = Some r -> is_agitated (axes (server w) axis) (axis_config c axis) = false ->
  sum <= 1000 * r + Z.of_nat n * r.
Proof.
  intros c axis w0 n sum w r ran is_axis ticked has_budget is_calm.
  destruct (type_budget (axis_config c axis) r has_budget) as [refills fits].
  assert (forall w, consistent c w ->
    is_agitated (axes (server w) axis) (axis_config c axis) = (1000 * r <? agitation (axes (server w) axis)))
    as agitated_by_its_sum.
  { intros w' [[_ [are_valid _]] _]. destruct (are_valid axis is_axis) as [own [shadow _]].
    destruct (agitation_of_an_axis_is_counted (axes (server w') axis)
      {| to_do := Hold; obtains := false; shadow_to_do := None; target := fun _ => 0; nominal_now := 0; remaining := 0 |}
      (axis_config c axis) own shadow) as [_ is_so].
    rewrite is_so, has_budget. reflexivity. }
  assert (consistent c w /\ (n = 0%nat \/ phase (discrete (server w)) = Obtain) /\
    (is_agitated (axes (server w) axis) (axis_config c axis) = false -> sum <= agitation (axes (server w) axis) + Z.of_nat n * r))
    as [ok [_ bounded]].
  { clear is_calm. induction ticked as [w rests | w0 n sum w input w' out before covered ticked taken obtained].
    - split; [exact (every_state_is_valid c w ran)|]. split; [auto|]. lia.
    - destruct (covered ran) as [ok [runs bounded]].
      split; [eapply a_tick_is_consistent; eauto|]. split; [auto|]. intros is_calm'.
      pose proof (a_tick_is_consistent c w input w' out ok ticked) as ok'.
      pose proof (taken_settles_nothing c w input ok taken) as same_server.
      assert (is_agitated (axes (server w) axis) (axis_config c axis) = false) as is_calm.
      { destruct (is_agitated (axes (server w) axis) (axis_config c axis)) eqn:shakes; auto. exfalso.
        destruct runs as [none | runs].
        - inversion before; subst; [|discriminate].
          rewrite (agitated_by_its_sum w ok), H in shakes. apply Z.ltb_lt in shakes. lia.
        - assert (agitated (facts c w input) = true) as seen.
          { unfold facts. rewrite same_server. simpl. apply existsb_exists. exists axis. split; [apply in_seq; lia|exact shakes]. }
          assert (is_live (discrete (settled c w input)) = true) as live by (rewrite same_server; unfold is_live; rewrite runs; auto).
          destruct (agitation_ends_a_session _ (facts c w input) (rules c) (type_config c)
            (settled_discrete c w input ok) seen live) as [over _].
          destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
          fold (decision c w input) in over. rewrite <- goes_on in over. unfold is_over in over.
          rewrite obtained in over. discriminate. }
      specialize (bounded is_calm).
      rewrite (agitated_by_its_sum w' ok') in is_calm'. apply Z.ltb_ge in is_calm'.
      rewrite (agitated_by_its_sum w ok) in is_calm. apply Z.ltb_ge in is_calm.
      destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on [_ [_ [_ acts]]]].
      destruct (acts axis is_axis) as [m [is_next [_ [_ [counts _]]]]].
      rewrite <- goes_on, obtained in counts.
      destruct ok as [[_ [are_valid _]] _]. destruct (are_valid axis is_axis) as [own [shadow _]].
      rewrite same_server in is_next.
      destruct (agitation_of_an_axis_is_counted _ m (axis_config c axis) own shadow) as [counted _].
      cbv zeta in counted. rewrite <- is_next, has_budget, counts in counted.
      cbv beta iota in counted.
      rewrite Nat2Z.inj_succ, Z.mul_succ_l. unfold largest_sum in counted. lia. }
  specialize (bounded is_calm). rewrite (agitated_by_its_sum w ok) in is_calm. apply Z.ltb_ge in is_calm. lia.
Qed.

(** An axis that is beyond its budget ends the session in that tick, with a step of the ramp. *)
Theorem T33_beyond_the_budget_it_ends : forall c w input w' out axis,
  run c w -> one_tick c w input w' out -> is_live (discrete (settled c w input)) = true ->
  (axis < N)%nat -> is_agitated (axes (settled c w input) axis) (axis_config c axis) = true ->
  is_over (discrete (server w')) = true /\
  forall axis k, (axis < N)%nat -> ramped (limits (axis_config c axis) k)
    (channels (axes (settled c w input) axis) k) (channels (axes (server w') axis) k).
Proof.
  intros c w input w' out axis ran ticked live is_axis shakes.
  pose proof (every_state_is_valid c w ran) as ok.
  assert (agitated (facts c w input) = true) as seen.
  { simpl. apply existsb_exists. exists axis. split; [apply in_seq; lia|exact shakes]. }
  destruct (agitation_ends_a_session _ (facts c w input) (rules c) (type_config c)
    (settled_discrete c w input ok) seen live) as [over is_ramp].
  destruct (tick_is_decided c w input w' out (proj1 ok) ticked) as [goes_on _].
  split; [rewrite goes_on; exact over|]. intros other k is_other.
  apply (channel_is_bounded c w input w' out other k ok ticked is_other). exact is_ramp.
Qed.

End OfThreeAndSixAxes.
(** * Position loops *)

(** A loop without a permit or an actual value, tick after tick: its velocity falls by the ramp in each,
    so that it is zero after the velocity over the ramp, rounded up, and not before. *)
Theorem T18_a_loop_stands_in_time : forall c inputs l, loop_valid c l ->
  (forall input, In input inputs -> is_permitted input = false \/ has_actual input = false) ->
  Z.abs (velocity (fold_left (loop_tick c) inputs l)) =
    Z.max 0 (Z.abs (velocity l) - Z.of_nat (length inputs) * velocity_ramp c).
Proof.
  intros c inputs. induction inputs as [|input inputs later]; intros l ok without; simpl fold_left.
  - simpl. lia.
  - destruct (type_loop c l ok) as [fits ramps].
    destruct (position_loop_stops_with_its_ramp c l input (Z.abs (velocity l)) ok ltac:(lia))
      as [needs_permit [needs_actual falls]].
    assert (is_stopped (loop_tick c l input) = true) as stops
      by (destruct (without input (or_introl eq_refl)); auto).
    destruct (falls stops) as [above below].
    specialize (above ltac:(lia)). specialize (below ltac:(lia)).
    rewrite (later (loop_tick c l input)).
    + replace (Z.abs (velocity (loop_tick c l input)))
        with (Z.max 0 (Z.abs (velocity l) - velocity_ramp c)) by lia.
      cbn [length]. rewrite Nat2Z.inj_succ, Z.mul_succ_l.
      assert (0 <= Z.of_nat (length inputs) * velocity_ramp c) by (apply Z.mul_nonneg_nonneg; lia).
      lia.
    + apply position_loop_references_are_bounded. exact ok.
    + intros other is_in. apply without. right. exact is_in.
Qed.

End Runs.
