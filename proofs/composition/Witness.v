(** Functions of which every row holds, at any number of axes: the axioms do not contradict each other.
    They are as simple as the rows allow, and no model of core. *)
From Coq Require Import ZArith List Bool Lia.
From Composition Require Import Rows.
Open Scope Z_scope.

Module Type SIZE.
  Parameter axes_of_all : nat.
End SIZE.

Module WitnessOf (Size : SIZE) <: ROWS.

Definition N := Size.axes_of_all.
Definition Config := unit.
(** Whether an axis has no budget of agitation to spend. *)
Definition AxisConfig := bool.
Definition rules (_ : Config) := {| handshake_ticks := 2; budget := None |}.
Definition axis_config (_ : Config) (axis : nat) : AxisConfig := (axis =? 2)%nat.
Definition limits (_ : AxisConfig) (_ : Kind) :=
  {| largest := 20; step_limit := 10; accel := 20; rho := 10 |}.
Definition lower (_ : AxisConfig) := -1000000.
Definition upper (_ : AxisConfig) := 1000000.
Definition accel_is_fault (_ : AxisConfig) := false.
Definition refill (g : AxisConfig) := Some (if g then 0 else 10).

(** A Hello, or a command with its target, which is 20 less for the axis without a budget. *)
Inductive Asks := Hello | Command (sequence : nat) (mode : Mode) (target : Z) | Goodbye.
Definition Event := Asks.
(** A key, and what a datagram says under a tag. *)
Definition Door := nat.
Definition Bytes := (nat * Event)%type.
Definition Epochs := unit.

(** ** The position loop: a velocity that follows nothing, and whether it is stopped *)

Definition PositionLoop := (Z * bool)%type.
Definition LoopConfig := unit.
(** A permit, and an actual value. *)
Definition LoopInput := (bool * bool)%type.
Definition loop_valid (_ : LoopConfig) (l : PositionLoop) := Z.abs (fst l) <= 1000.
Definition velocity (l : PositionLoop) := fst l.
Definition velocity_ramp (_ : LoopConfig) := 10.
Definition is_stopped (l : PositionLoop) := snd l.
Definition is_permitted (input : LoopInput) := fst input.
Definition has_actual (input : LoopInput) := snd input.
Definition loop_tick (_ : LoopConfig) (l : PositionLoop) (input : LoopInput) : PositionLoop :=
  if fst input && snd input then (fst l, false)
  else (Z.sgn (fst l) * Z.max 0 (Z.abs (fst l) - 10), true).

(** ** The decision *)

Definition goes p own s (b : bool) := {|
  phase := p; owner := own; epoch := epoch s; accepted := accepted s; tick_number := S (tick_number s);
  misses := if b then 1%nat else 0%nat; history := if b then 1%N else 0%N; waited := 0;
  rearm_released := false; latched := false |}.
Definition to_fault s f := {|
  phase := Fault; owner := owner s; epoch := epoch s; accepted := accepted s;
  tick_number := S (tick_number s); misses := 0; history := 0%N; waited := 0;
  rearm_released := rearm_released s || negb (rearm f); latched := true |}.
Definition grants s from e := {|
  phase := Handshake; owner := Some from; epoch := e; accepted := 0; tick_number := S (tick_number s);
  misses := 0; history := 0%N; waited := 0; rearm_released := false; latched := false |}.
Definition waits s := {|
  phase := Handshake; owner := owner s; epoch := epoch s; accepted := accepted s;
  tick_number := S (tick_number s); misses := 0; history := 0%N; waited := S (waited s);
  rearm_released := false; latched := false |}.
Definition takes p s sequence := {|
  phase := p; owner := owner s; epoch := epoch s; accepted := sequence; tick_number := S (tick_number s);
  misses := 0; history := 0%N; waited := 0; rearm_released := false; latched := false |}.

Definition does n a := {| next := n; action := a; by_budget := false |}.
Definition ends s := does (goes SafeDisconnect (owner s) s false) Ramp.
Definition breaks f := framing f || flood f || closed f || goodbye f || agitated f.

Definition decide s f (r : Rules) :=
  if stop f || quit f || nominal_fault f then does (to_fault s f) Ramp
  else match phase s with
  | Fault => if rearm f && rearm_released s && all_zero f then does (goes Listening None s false) Hold
      else does (to_fault s f) Ramp
  | SafeDisconnect => if all_zero f then does (goes Listening None s false) Hold else ends s
  | Listening => match hello f with
      | Some (from, e) => does (if (epoch s <? e)%nat then grants s from e else goes Listening None s false) Hold
      | None => does (goes Listening None s false) Hold
      end
  | Handshake => if breaks f then ends s else match command f with
      | Some (sequence, _) => does (takes Submit s sequence) Hold
      | None => if (S (waited s) <? handshake_ticks r)%nat then does (waits s) Hold else ends s
      end
  | Submit | Obtain =>
      let in_a_row := (misses s + skipped f)%nat in
      if breaks f || (2 <=? in_a_row)%nat || (in_a_row =? 1)%nat && (match command f with None => true | _ => false end)
      then ends s
      else match command f with
      | None => does (goes (phase s) (owner s) s true) Hold
      | Some (sequence, ToSubmit) =>
          does (takes (phase s) s sequence) (match phase s with Obtain => FollowZero | _ => Hold end)
      | Some (sequence, ToObtain) => does (takes Obtain s sequence) Follow
      end
  end.

(** ** An axis *)

Definition moved before to := {| count := to; change := to - count before |}.
Definition approach h goal :=
  let goal := clamp (-20) 20 goal in moved h (count h + clamp (-10) 10 (goal - count h)).
Definition ramp_of h := moved h (if 0 <=? count h then Z.max 0 (count h - 10) else Z.min 0 (count h + 10)).
Definition acts a goal h :=
  match a with
  | Hold => {| count := count h; change := 0 |}
  | Follow => approach h goal
  | FollowZero => approach h 0
  | Ramp => ramp_of h
  end.
Definition resting := {| count := 0; change := 0 |}.
Definition value (_ : Kind) h := count h.
Definition nominal_stepped x y (_ : AxisConfig) n := Z.of_nat n * 1000 <? Z.abs (y - x).
Definition nominal_accelerated (_ : Axis) (_ : Z) (_ : AxisConfig) := false.
Definition is_agitated a (g : AxisConfig) :=
  match refill g with Some r => 1000 * r <? agitation a | None => false end.
Definition act a m (g : AxisConfig) :=
  let after k := acts (to_do m) (target m k) (channels a k) in
  let d := Z.abs (change (after Position) - change (channels a Position)) in
  ({| channels := after;
      shadow := fun k => match shadow_to_do m with
        | Some todo => acts todo (target m k) (shadow a k) | None => resting end;
      nominal := nominal_now m;
      agitation := if obtains m then Z.max 0 (Z.min (agitation a + d) largest_sum - (if g then 0 else 10)) else 0;
      others := others a |},
   {| position := clamp (-1000000) 1000000 (nominal_now m + count (after Position));
      pushes := fun k => count (after k) |}).
Definition held a :=
  (a, {| position := nominal a; pushes := fun k => count (channels a k) |}).

Include Terms.

(** ** A tick *)

Definition is_from (own : option nat) from := match own with Some who => (who =? from)%nat | None => false end.
Definition is_authentic (key : Door) (bytes : Bytes) := Nat.eqb (fst bytes) key.
Definition take (key : Door) (bytes : Bytes) := if is_authentic key bytes then Some (snd bytes) else None.
Definition sift (c : Config) s (_ : Epochs) (heard : nat * Event) a :=
  let (from, event) := heard in
  let f := asked a in
  let with_f f t := {| asked := f; targets := t |} in
  match event, phase (discrete s) with
  | Hello, Listening => with_f {|
      stop := stop f; quit := quit f; rearm := rearm f; nominal_fault := nominal_fault f;
      framing := framing f; flood := flood f; closed := closed f; goodbye := goodbye f;
      agitated := agitated f; command := command f; hello := Some (from, S (epoch (discrete s)));
      skipped := skipped f; all_zero := all_zero f |} (targets a)
  | Command sequence mode goal, _ => if is_from (owner (discrete s)) from && (accepted (discrete s) <? sequence)%nat then with_f {|
      stop := stop f; quit := quit f; rearm := rearm f; nominal_fault := nominal_fault f;
      framing := framing f; flood := flood f; closed := closed f; goodbye := goodbye f;
      agitated := agitated f; command := Some (sequence, mode); hello := hello f;
      skipped := skipped f; all_zero := all_zero f |} (fun axis _ => if (axis =? 2)%nat then goal - 20 else goal) else a
  | _, _ => a
  end.
Definition classify c s epochs events :=
  fold_left (fun a event => sift c s epochs event a) events nothing.

Definition order c s i refused a :=
  let f := complete c s i refused a in
  let d := decide (discrete s) f (rules c) in
  (d, f, {|
    do_all := action d;
    all_obtain := match phase (next d) with Obtain => true | _ => false end;
    shadows := shadow_of (phase (next d)) f;
    flags := fun _ => 0; is_paced := paces s i;
    holds := negb (is_read i) || off_path s && nominal_fault f |}).
Definition carry_out (c : Config) of_axes o i a
    (by_itself : Axis -> option (AxisCommand * AxisConfig) -> Axis * Reference) axis :=
  by_itself (of_axes axis) (Some (command_of o i a (of_axes axis) axis 0, axis_config c axis)).
Definition step c s i refused a :=
  let '(d, _, o) := order c s i refused a in
  let acted := carry_out c (axes s) o i a act_or_hold in
  ({| discrete := next d; axes := fun axis => fst (acted axis); withheld := withheld s;
      off_path := holds o; paced := is_paced o; noted := noted s |},
   {| references := fun axis => snd (acted axis); is_withheld := withheld s |}).

Definition is_within (c : Config) (found : nat -> InForce) :=
  every (fun i => all_kinds (fun k => Z.abs (offsets_in_force (found i) k) <=? 20)).
Definition over s := match phase s with
  | Fault => s
  | _ => goes SafeDisconnect (owner s) s false
  end.
Definition rest_at (found : InForce) := {|
  channels := fun k => {| count := offsets_in_force found k; change := 0 |};
  shadow := fun _ => resting; nominal := nominal_in_force found; agitation := 0; others := 0 |}.
Definition stays a := {|
  channels := channels a; shadow := fun _ => resting; nominal := nominal a; agitation := 0;
  others := others a |}.
Definition withholds s := {|
  discrete := over (discrete s); axes := fun i => stays (axes s i); withheld := true;
  off_path := off_path s; paced := paced s; noted := noted s |}.
Definition settle (c : Config) s w :=
  match w with
  | Taken => s
  | Refused found => if is_within c found then {|
      discrete := over (discrete s); axes := fun i => rest_at (found i); withheld := false;
      off_path := true; paced := false; noted := noted s |} else withholds s
  | Unknown => withholds s
  end.
Definition tick c s w events epochs i :=
  let settled := settle c s w in
  step c settled i (match w with Taken => false | _ => true end) (classify c settled epochs events).

Definition blank p is_latched := {|
  phase := p; owner := None; epoch := 0; accepted := 0; tick_number := 0; misses := 0; history := 0%N;
  waited := 0; rearm_released := false; latched := is_latched |}.
Definition are_zero (found : nat -> InForce) :=
  every (fun i => all_kinds (fun k => offsets_in_force (found i) k =? 0)).
Definition start (c : Config) told :=
  if is_within c (in_force told) then Some {|
    discrete := if stop_latched told then blank Fault true
      else blank (if are_zero (in_force told) then Listening else SafeDisconnect) false;
    axes := fun i => rest_at (in_force told i); withheld := false; off_path := true; paced := false;
    noted := 0 |}
  else None.

Include Statements.

(** ** The rows *)

(** Every case of a decision. *)
Ltac cases := repeat (match goal with
  | |- context [if ?b then _ else _] => destruct b eqn:?
  | |- context [match ?x with Some _ => _ | None => _ end] => destruct x eqn:?
  | |- context [let (_, _) := ?x in _] => destruct x eqn:?
  | |- context [match ?x with Listening => _ | Handshake => _ | Submit => _ | Obtain => _ | SafeDisconnect => _
      | Fault => _ end] => is_var x; destruct x eqn:?
  | |- context [match ?x with ToSubmit => _ | ToObtain => _ end] => destruct x eqn:?
  end; simpl in * ).
Ltac of_state s := destruct s as [p own e accepted_ n m h w released latch]; simpl in *.

Lemma decide_keeps_the_invariant : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> discrete_valid (handshake_ticks r) (next (decide s f r)).
Proof.
  intros s f r some is_valid. of_state s. unfold discrete_valid, decide, is_running in *. simpl in *.
  destruct p; cases; intuition (try congruence; try lia); try (apply Nat.ltb_lt; assumption).
Qed.

Lemma decide_second_miss_ends : forall s f r, (0 < handshake_ticks r)%nat ->
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
Proof.
  intros s f r _ _ runs free d run. unfold outranks_a_miss in free.
  repeat (apply orb_false_elim in free; destruct free as [free ?]).
  subst d run. unfold decide, breaks, is_running in *.
  repeat match goal with H : _ f = false |- _ => rewrite H end.
  destruct s as [p own e accepted_ n m h w released latch]. cbn -[Nat.leb Nat.eqb Nat.add] in *.
  destruct p; try discriminate; cbn -[Nat.leb Nat.eqb Nat.add];
    destruct ((2 <=? m + skipped f)%nat || (m + skipped f =? 1)%nat && (match command f with None => true | _ => false end));
    cbn; auto; destruct (command f) as [[sequence []]|]; cbn; auto.
Qed.

Lemma decide_authority_needs_zero : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> let n := next (decide s f r) in
  (is_live n = true -> is_live s = false -> phase s = Listening /\ phase n = Handshake /\
    exists from, hello f = Some (from, epoch n) /\ owner n = Some from) /\
  (phase n = Listening -> phase s <> Listening -> all_zero f = true).
Proof.
  intros s f r _ _ n. subst n. of_state s. unfold decide, is_live. simpl.
  destruct p; cases; split; intros; simpl in *; try discriminate; try congruence; eauto;
    repeat match goal with H : _ && _ = true |- _ => apply andb_prop in H; destruct H end; auto.
Qed.

Lemma decide_stop_leads_to_fault : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> let d := decide s f r in
  (stop f || quit f || nominal_fault f = true -> phase (next d) = Fault /\ action d = Ramp) /\
  rearm_released (next d) =
    (match phase (next d) with Fault => true | _ => false end && (rearm_released s || negb (rearm f))) /\
  (phase s = Fault -> rearm f && rearm_released s && all_zero f = false ->
    phase (next d) = Fault).
Proof.
  intros s f r _ _ d. subst d. of_state s. unfold decide. simpl.
  destruct p; cases; repeat split; intros; simpl in *; try discriminate; try congruence; auto.
Qed.

Lemma decide_no_session_ramps : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> let d := decide s f r in
  is_over s = true -> all_zero f = false -> action d = Ramp /\ is_live (next d) = false.
Proof.
  intros s f r _ _ d. subst d. of_state s. unfold decide, is_over, is_live. simpl.
  destruct p; cases; repeat split; intros; simpl in *; try discriminate; try congruence; auto;
    repeat match goal with H : _ && _ = true |- _ => apply andb_prop in H; destruct H end; congruence.
Qed.

Lemma decide_silence_leads_to_listening : forall s zero shaken r, (0 < handshake_ticks r)%nat ->
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
Proof.
  intros s zero shaken r _ is_valid d over. subst over d. of_state s.
  unfold discrete_valid, is_running in is_valid. simpl in is_valid. destruct is_valid as [_ [missed _]].
  unfold decide, breaks. simpl.
  destruct p; simpl; auto.
  - destruct shaken; simpl; auto. destruct (S w <? handshake_ticks r)%nat; simpl; auto.
  - destruct shaken; simpl; auto. subst m. destruct (N.odd h); simpl; auto.
  - destruct shaken; simpl; auto. subst m. destruct (N.odd h); simpl; auto.
  - destruct zero; simpl; auto.
Qed.

Lemma decide_epochs_and_sequences_rise : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> is_new s f ->
  let d := decide s f r in
  if (epoch (next d) =? epoch s)%nat
  then (phase (next d) = Handshake -> phase s = Handshake) /\ (accepted s <= accepted (next d))%nat /\
    (action d = Follow \/ action d = FollowZero -> (accepted s < accepted (next d))%nat)
  else (epoch s < epoch (next d))%nat /\ phase s = Listening /\ phase (next d) = Handshake.
Proof.
  intros s f r _ _ [new_epoch new_sequence] d. subst d. of_state s. unfold decide. simpl.
  assert (forall a mode, command f = Some (a, mode) -> (accepted_ < a)%nat) as newer by exact new_sequence.
  assert (forall from a, hello f = Some (from, a) -> (e < a)%nat) as later by exact new_epoch.
  clear new_epoch new_sequence.
  destruct (stop f || quit f || nominal_fault f); simpl.
  { rewrite Nat.eqb_refl. repeat split; try lia; intros; try discriminate; destruct H; discriminate. }
  destruct p; simpl.
  - destruct (hello f) as [[from a]|] eqn:asked_for; simpl.
    + specialize (later from a eq_refl). assert ((e <? a)%nat = true) as is_later by (apply Nat.ltb_lt; exact later).
      rewrite is_later. simpl. assert ((a =? e)%nat = false) as other by (apply Nat.eqb_neq; lia). rewrite other. auto.
    + rewrite Nat.eqb_refl. repeat split; try lia; intros; try discriminate; destruct H; discriminate.
  - destruct (breaks f); simpl; [|destruct (command f) as [[a mode]|]; simpl;
      [specialize (newer a mode eq_refl)|destruct (S w <? handshake_ticks r)%nat; simpl]];
      rewrite Nat.eqb_refl; repeat split; try lia; intros; try discriminate; auto; destruct H; discriminate.
  - destruct (breaks f || _ || _); simpl; [|destruct (command f) as [[a mode]|]; simpl;
      [specialize (newer a mode eq_refl); destruct mode; simpl|]];
      rewrite Nat.eqb_refl; repeat split; try lia; intros; try discriminate; auto; destruct H; discriminate.
  - destruct (breaks f || _ || _); simpl; [|destruct (command f) as [[a mode]|]; simpl;
      [specialize (newer a mode eq_refl); destruct mode; simpl|]];
      rewrite Nat.eqb_refl; repeat split; try lia; intros; try discriminate; auto; destruct H; discriminate.
  - destruct (all_zero f); simpl; rewrite Nat.eqb_refl; repeat split; try lia; intros; try discriminate;
      destruct H; discriminate.
  - destruct (rearm f && released && all_zero f); simpl; rewrite Nat.eqb_refl; repeat split; try lia; intros;
      try discriminate; destruct H; discriminate.
Qed.

Lemma agitation_ends_a_session : forall s f r, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> agitated f = true -> is_live s = true ->
  is_over (next (decide s f r)) = true /\ action (decide s f r) = Ramp.
Proof.
  intros s f r _ _ shaken live. of_state s. unfold decide, breaks, is_over, is_live in *. rewrite shaken, orb_true_r.
  destruct (stop f || quit f || nominal_fault f); simpl; auto. destruct p; try discriminate; simpl; auto.
Qed.

Lemma acts_is_valid : forall g k a goal h, channel_valid (limits g k) h -> channel_valid (limits g k) (acts a goal h).
Proof.
  intros g k a goal h. unfold channel_valid. simpl. intros [within slow].
  destruct a; simpl; unfold clamp; try lia. destruct (0 <=? count h) eqn:sign;
    [apply Z.leb_le in sign | apply Z.leb_gt in sign]; lia.
Qed.

Lemma all_are_bounded : forall k, bounded_in k.
Proof.
  intros k a m g own _. destruct (own k) as [within slow]. simpl in within, slow. simpl.
  pose proof (acts_is_valid g k (to_do m) (target m k) (channels a k) (own k)) as is_valid.
  assert (forall h, 0 <= h -> (0 <=? h) = true) as up by (intros; apply Z.leb_le; assumption).
  assert (forall h, h < 0 -> (0 <=? h) = false) as down by (intros; apply Z.leb_gt; assumption).
  unfold channel_valid, admits, value, ramped, lower, upper in *. simpl in *.
  set (h := channels a k) in *. clearbody h. destruct h as [v d]. simpl in *.
  split; [|split; [|split; [|split; [|split; [|split; [|split; [|split; [|split]]]]]]]]; try apply is_valid; auto.
  - destruct (to_do m); simpl; unfold clamp; try lia. destruct (Z_le_dec 0 v); [rewrite up | rewrite down]; lia.
  - destruct (to_do m); simpl; unfold clamp; lia.
  - destruct (to_do m); simpl; unfold clamp; try lia. destruct (Z_le_dec 0 v); [rewrite up | rewrite down]; lia.
  - intros is_ramp. rewrite is_ramp. simpl. destruct (Z_le_dec 0 v); [rewrite up | rewrite down]; lia.
  - unfold clamp. lia.
Qed.
Definition axis_position_is_bounded := all_are_bounded Position.
Definition axis_velocity_is_bounded := all_are_bounded Velocity.
Definition axis_torque_is_bounded := all_are_bounded Torque.

Lemma channel_value_is_its_count : forall g k h, channel_valid (limits g k) h -> value k h = count h.
Proof. reflexivity. Qed.

Lemma nominal_that_stands_is_within : forall x g n, nominal_stepped x x g n = false.
Proof. intros x g n. unfold nominal_stepped. apply Z.ltb_ge. lia. Qed.

Lemma agitation_of_an_axis_is_counted : forall a m g,
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
Proof. intros. split; reflexivity. Qed.

(** A decision lets nothing move that must rest in the next phase. *)
Lemma decide_lets_rest : forall s f r, discrete_valid (handshake_ticks r) s ->
  let d := decide s f r in
  match phase (next d) with
  | Listening => action d = Hold /\ (phase s = Listening \/ all_zero f = true)
  | Handshake => action d = Hold /\ (phase s = Listening \/ phase s = Handshake)
  | Submit => action d = Hold /\ (phase s = Handshake \/ phase s = Submit)
  | _ => True
  end.
Proof.
  intros s f r _ d. subst d. of_state s. unfold decide. simpl.
  destruct p; cases; auto; repeat match goal with H : _ && _ = true |- _ => apply andb_prop in H; destruct H end; auto.
Qed.

Lemma session_axis_of_many_stays_valid : forall a g s f r m, (0 < handshake_ticks r)%nat ->
  discrete_valid (handshake_ticks r) s -> axis_valid (phase s) g a ->
  (all_zero f = true -> forall k, count (channels a k) = 0) ->
  let d := decide s f r in
  to_do m = action d -> obtains m = (match phase (next d) with Obtain => true | _ => false end) ->
  shadow_to_do m = shadow_of (phase (next d)) f ->
  axis_valid (phase (next d)) g (fst (act a m g)).
Proof.
  intros a g s f r m _ is_valid [own [shadows [rests [shadow_rests _]]]] zero d does obtained shadowed.
  pose proof (decide_lets_rest s f r is_valid) as lets. cbv zeta in lets. subst d.
  split; [|split; [|split; [|split]]]; simpl.
  - intros k. apply acts_is_valid. apply own.
  - intros k. destruct (shadow_to_do m); [apply acts_is_valid, shadows|]. unfold channel_valid. simpl. lia.
  - intros is_resting k. rewrite does.
    destruct is_resting as [next_is | [next_is | next_is]]; rewrite next_is in lets; destruct lets as [holding from];
      rewrite holding; unfold at_zero; simpl; split; auto.
    + destruct from as [listened | is_zero]; [apply rests; auto | auto].
    + apply rests. destruct from; auto.
    + apply rests. destruct from; auto.
  - rewrite shadowed. destruct (phase (next (decide s f r))); auto; right; intros k; unfold at_zero; simpl; auto.
  - rewrite obtained. destruct (phase (next (decide s f r))); auto. left. split; [reflexivity|discriminate].
Qed.

Lemma every_says : forall test, every test = true <-> (forall i, (i < N)%nat -> test i = true).
Proof.
  intros test. unfold every. rewrite forallb_forall. split; intros all i within.
  - apply all. apply in_seq. lia.
  - apply all. apply in_seq in within. lia.
Qed.

Lemma is_within_says : forall c found, is_within c found = true <-> within_limits c found.
Proof.
  intros c found. unfold is_within, within_limits, admits, all_kinds. rewrite every_says. simpl. split; intros all i.
  - intros k within. specialize (all i within).
    apply andb_prop in all as [all torque]. apply andb_prop in all as [place velocity].
    destruct k; apply Z.leb_le; assumption.
  - intros within. pose proof (all i Position within). pose proof (all i Velocity within).
    pose proof (all i Torque within). rewrite !andb_true_iff, !Z.leb_le. auto.
Qed.

Lemma over_says : forall ticks s, discrete_valid ticks s ->
  discrete_valid ticks (over s) /\ is_over (over s) = true /\ epoch (over s) = epoch s /\
  accepted (over s) = accepted s /\ rearm_released (over s) = rearm_released s.
Proof.
  intros ticks s. of_state s. unfold discrete_valid, is_running, is_over, over. simpl.
  intros [owns [missed [waited_ [faulty | [none no_latch]]]]]; destruct p; try discriminate; simpl; subst; auto 12.
Qed.

Lemma over_is_no_place_of_rest : forall s, is_over s = true ->
  ~ (phase s = Listening \/ phase s = Handshake \/ phase s = Submit).
Proof. intros s over [is_so | [is_so | is_so]]; unfold is_over in over; rewrite is_so in over; discriminate. Qed.

Lemma withholds_is_valid : forall c s, valid c s -> valid c (withholds s).
Proof.
  intros c s [discrete_ok [axes_ok _]]. destruct (over_says _ _ discrete_ok) as [over_ok [is_over _]].
  split; [exact over_ok|]. split; [|intros _; exact is_over].
  intros i within. destruct (axes_ok i within) as [own _]. simpl.
  split; [exact own|]. split; [intros k; unfold channel_valid; simpl; lia|].
  split; [intros rests; destruct (over_is_no_place_of_rest _ is_over rests)|].
  split; [right; intros k; unfold at_zero; auto|auto].
Qed.

Lemma rest_is_valid : forall c i found p, (forall k, admits (limits (axis_config c i) k) (offsets_in_force found k)) ->
  (~ (p = Listening \/ p = Handshake \/ p = Submit) \/ forall k, offsets_in_force found k = 0) ->
  axis_valid p (axis_config c i) (rest_at found).
Proof.
  intros c i found p within rests. unfold admits in within. simpl in within.
  split; [intros k; unfold channel_valid; simpl; specialize (within k); lia|].
  split; [intros k; unfold channel_valid; simpl; lia|]. split.
  - intros is_resting. destruct rests as [none | zero]; [contradiction|]. intros k. unfold at_zero. simpl. auto.
  - split; [right; intros k; unfold at_zero; auto|auto].
Qed.

Lemma all_settle : settles.
Proof.
  intros c s w is_valid after. pose proof is_valid as [discrete_ok [axes_ok _]].
  pose proof (over_says _ _ discrete_ok) as [over_ok [is_over [same_epoch [same_sequence same_release]]]].
  subst after. destruct w as [|found|]; simpl.
  - auto 10.
  - destruct (is_within c found) eqn:is_so; simpl.
    + apply is_within_says in is_so. split.
      * split; [exact over_ok|]. split; [|discriminate]. intros i within. simpl.
        apply rest_is_valid; [intros k; apply is_so; exact within|left; apply over_is_no_place_of_rest; exact is_over].
      * repeat split; auto; try discriminate; intros; contradiction.
    + assert (~ within_limits c found) as unknown by (rewrite <- is_within_says, is_so; discriminate).
      split; [apply withholds_is_valid; exact is_valid|]. repeat split; auto; intros; contradiction.
  - split; [apply withholds_is_valid; exact is_valid|]. repeat split; auto.
Qed.
Definition total_write (_ : N = 3%nat) := all_settle.
Definition total_write_of_six (_ : N = 6%nat) := all_settle.

Lemma all_order : orders.
Proof. intros c s i refused a _. simpl. auto. Qed.
Definition session_orders_what_is_decided (_ : N = 3%nat) := all_order.
Definition session_of_6_axes_orders_what_is_decided (_ : N = 6%nat) := all_order.

Lemma all_decide : decides.
Proof. intros c s i refused a _. reflexivity. Qed.
Definition session_decides_by_the_rules (_ : N = 3%nat) := all_decide.
Definition session_of_6_axes_decides_by_the_rules (_ : N = 6%nat) := all_decide.

Lemma all_have_parts : has_parts.
Proof. intros c s i refused a _. simpl. auto 10. Qed.
Definition session_step_is_its_parts (_ : N = 3%nat) := all_have_parts.
Definition session_of_6_axes_step_is_its_parts (_ : N = 6%nat) := all_have_parts.

Lemma all_act_by_themselves : act_by_themselves.
Proof. intros c s i a o by_itself axis _ _. exists 0. reflexivity. Qed.
Definition session_of_3_axes_acts_axis_by_axis (_ : N = 3%nat) := all_act_by_themselves.
Definition session_of_6_axes_acts_axis_by_axis (_ : N = 6%nat) := all_act_by_themselves.

Lemma all_ticks_have_parts : tick_has_parts.
Proof. intros c s w events epochs i _. unfold tick. destruct (step _ _ _ _ _). auto 10. Qed.
Definition session_tick_is_its_parts (_ : N = 3%nat) := all_ticks_have_parts.
Definition session_of_6_axes_tick_is_its_parts (_ : N = 6%nat) := all_ticks_have_parts.

Lemma sift_only_the_owner_decides : N = 3%nat -> forall c s epochs from event a, valid c s ->
  owner (discrete s) <> Some from -> phase (discrete s) <> Listening ->
  sift c s epochs (from, event) a = a.
Proof.
  intros _ c s epochs from event a _ other active. unfold sift. destruct event as [|sequence mode goal|].
  - destruct (phase (discrete s)); congruence.
  - destruct (is_from (owner (discrete s)) from) eqn:is_so; [exfalso|reflexivity].
    unfold is_from in is_so. destruct (owner (discrete s)); [|discriminate].
    apply Nat.eqb_eq in is_so. congruence.
  - destruct (phase (discrete s)); reflexivity.
Qed.

Lemma slot_forgery_is_nothing : N = 3%nat -> forall door bytes,
  is_authentic door bytes = false -> take door bytes = None.
Proof. intros _ door bytes is_forged. unfold take. rewrite is_forged. reflexivity. Qed.

Lemma sift_accepts_only_what_is_new : N = 3%nat -> forall c s epochs event a, valid c s ->
  is_new (discrete s) (asked a) -> is_new (discrete s) (asked (sift c s epochs event a)).
Proof.
  intros _ c s epochs [from event] a _ [new_epoch new_sequence]. unfold sift.
  destruct event as [|sequence mode goal|].
  - destruct (phase (discrete s)); split; simpl; auto. intros whom e asked_for. inversion asked_for. lia.
  - destruct (is_from _ _ && _) eqn:is_later; [|split; assumption].
    apply andb_prop in is_later as [_ is_later]. apply Nat.ltb_lt in is_later. split; simpl; auto. intros x y is_it. inversion is_it. subst. exact is_later.
  - split; assumption.
Qed.

Lemma all_start : starts.
Proof.
  intros c told. unfold start. destruct (is_within c (in_force told)) eqn:is_so.
  - apply is_within_says in is_so. split; [exact is_so|]. simpl. split.
    + split; [|split; [|discriminate]].
      * destruct (stop_latched told); [|destruct (are_zero (in_force told))]; unfold discrete_valid; simpl; auto 10.
      * intros i within. apply rest_is_valid; [intros k; apply is_so; exact within|]. simpl.
        destruct (stop_latched told); [left; intros [none | [none | none]]; discriminate|].
        destruct (are_zero (in_force told)) eqn:zero; [right|left; intros [none | [none | none]]; discriminate].
        unfold are_zero in zero. rewrite every_says in zero. specialize (zero i within). unfold all_kinds in zero.
        apply andb_prop in zero as [zero torque]. apply andb_prop in zero as [place velocity].
        intros k. destruct k; apply Z.eqb_eq; assumption.
    + repeat split; auto; destruct (stop_latched told); auto; try discriminate;
        destruct (are_zero (in_force told)); auto.
  - exact I.
Qed.
Definition total_start (_ : N = 3%nat) := all_start.
Definition total_start_of_six (_ : N = 6%nat) := all_start.

Lemma a_ramp_falls : forall v, Z.abs (Z.sgn v * Z.max 0 (Z.abs v - 10)) = Z.max 0 (Z.abs v - 10).
Proof. intros v. destruct v; simpl Z.sgn; lia. Qed.
Lemma position_loop_references_are_bounded : forall c l input,
  loop_valid c l -> loop_valid c (loop_tick c l input).
Proof.
  intros c [v stopped] [permit actual] ok. unfold loop_valid, loop_tick in *. simpl in *.
  destruct (permit && actual); cbn [fst]; [exact ok|]. rewrite a_ramp_falls. lia.
Qed.
Lemma position_loop_stops_with_its_ramp : forall c l input bound,
  loop_valid c l -> 0 <= bound <= 4294967295 ->
  let after := loop_tick c l input in
  let lowered := Z.max 0 (bound - velocity_ramp c) in
  (is_permitted input = false -> is_stopped after = true) /\
  (has_actual input = false -> is_stopped after = true) /\
  (is_stopped after = true ->
    (Z.abs (velocity l) <= bound -> Z.abs (velocity after) <= lowered) /\
    (bound <= Z.abs (velocity l) -> lowered <= Z.abs (velocity after))).
Proof.
  intros c [v stopped] [permit actual] bound ok is_bound.
  unfold loop_tick, is_stopped, is_permitted, has_actual, velocity, velocity_ramp. cbn [fst snd].
  destruct permit, actual; cbn [andb fst snd]; repeat split; intros; try discriminate; auto;
    rewrite a_ramp_falls; lia.
Qed.
Lemma type_loop : forall c l, loop_valid c l -> Z.abs (velocity l) <= 2147483648 /\ 0 <= velocity_ramp c.
Proof. intros c l ok. unfold loop_valid, velocity, velocity_ramp in *. lia. Qed.

Lemma type_limits : forall g k, 0 <= largest (limits g k) /\ 0 <= rho (limits g k).
Proof. intros. simpl. lia. Qed.
Lemma type_budget : forall g r, refill g = Some r -> 0 <= r <= 1000000.
Proof. intros g r is_so. inversion is_so. destruct g; lia. Qed.
Lemma type_config : forall c, (0 < handshake_ticks (rules c))%nat.
Proof. intros. simpl. lia. Qed.
Lemma read_classify_is_one_by_one : forall c s epochs events,
  classify c s epochs events = fold_left (fun a event => sift c s epochs event a) events nothing.
Proof. reflexivity. Qed.

End WitnessOf.

Module ThreeAxes <: SIZE.
  Definition axes_of_all := 3%nat.
End ThreeAxes.
Module SixAxes <: SIZE.
  Definition axes_of_all := 6%nat.
End SixAxes.
Module OfThree := WitnessOf ThreeAxes.
Module OfSix := WitnessOf SixAxes.
