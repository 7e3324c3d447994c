(** Certified robots that stop at once: their requirements, the commands of an earlier process that may still be in
    effect, and bounds on the motion since the sample of the command in force, for any losses, delays, stops and
    restarts. *)

Require Import Reals Lra Psatz Lia.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard.
Open Scope R_scope.

(** ** Guarantees of the agent. *)

(** The command is zero: `Twist::ZERO`, the answer without known neighbors or without a certificate. A command that
    only turns the robot in place is not zero: it may turn the robot while an older twist is still in force. *)
Definition stands (c : command) : Prop := speed c = 0 /\ across c = 0 /\ turn c = 0.

(** Bounds v_own and turn rates that cover the command and every earlier command that may still be in effect.
    The agent knows those of its own process (`unexpired_commands`). Of an earlier process it only knows that
    the plant limits the speed to v_max. *)
Definition covers_the_alive (S : setting) (r : robot) (k : nat) (v_own w_low w_high : R) : Prop :=
  forall l, (l < k)%nat -> stamp (computed r k) < stamp (computed r l) + lifetime S ->
  (incarnation (computed r l) = incarnation (computed r k) ->
     covers v_own w_low w_high (computed r l)) /\
  (incarnation (computed r l) <> incarnation (computed r k) ->
     v_max S <= v_own /\ w_low <= - spin r /\ spin r <= w_high).

(** Command k of robot r is zero, or certified against every other robot. *)
Definition certified (S : setting) (r : robot) (others : robot -> Prop) (k : nat) : Prop :=
  let c := computed r k in
  stands c \/
  exists v_own w_low w_high,
    0 <= v_own <= v_max S /\ w_low <= 0 <= w_high /\
    covers v_own w_low w_high c /\
    covers_the_alive S r k v_own w_low w_high /\
    forall o, others o ->
      respects S v_own w_low w_high (heading r (stamp c)) c
               (minus (front r (stamp c)) (front o (stamp c))).

(** Requirements on one robot. *)
Definition guarded (S : setting) (others : robot -> Prop) (r : robot) : Prop :=
  moves r /\
  obeys (lifetime S) (v_max S) r /\
  chronological (mail r) /\
  one_living_incarnation (computed r) /\
  sent_by (computed r) (mail r) /\
  forall k, 0 <= stamp (computed r k) /\ certified S r others k.

(** ** Commands of an earlier process, after a restart. *)

(** `Guard::drop_expired_commands` sets `predecessor_end_ns` to the first stamp + H: until then the guard assumes v_max
    and +-v_max/ell. This is long enough. *)
Theorem after_the_first_lifetime_no_predecessor_is_alive (computed : nat -> command) (h : R) f k l :
  one_living_incarnation computed ->
  (* f is the first of its incarnation, which is that of k *)
  incarnation (computed f) = incarnation (computed k) ->
  (forall l, (l < f)%nat -> incarnation (computed l) <> incarnation (computed f)) ->
  (l < k)%nat -> incarnation (computed l) <> incarnation (computed k) ->
  stamp (computed k) < stamp (computed l) + h ->
  stamp (computed k) < stamp (computed f) + h.
Proof.
  intros Hone Hf _ Hlk Hdiff Halive.
  assert (Hinc := incarnations_in_order computed l k Hone ltac:(lia)).
  assert (Hlf : (l < f)%nat).
  { destruct (Compare_dec.le_lt_dec f l) as [Hfl|]; [exfalso|assumption].
    pose proof (incarnations_in_order computed f l Hone Hfl). lia. }
  destruct (Hone l f Hlf) as [_ Hst]. lra.
Qed.

(** In lockstep H = T, and a restarted process answers later ticks only: all commands of its predecessor have
    expired, so `may_have_predecessor` is not needed. *)
Theorem in_lockstep_no_command_of_an_earlier_tick_is_alive (T : R) (earlier later : nat) :
  0 < T -> (earlier < later)%nat -> ~ INR later * T < INR earlier * T + T.
Proof.
  intros HT Hlt Halive. apply le_INR in Hlt. rewrite S_INR in Hlt.
  assert ((INR earlier + 1) * T <= INR later * T) by (apply Rmult_le_compat_r; lra). lra.
Qed.

(** ** Motion between the sample of the command in force and the current time. *)

Lemma part_of_a_command a b lam : 0 <= lam <= 1 -> norm (lam * a, lam * b) <= norm (a, b).
Proof.
  intros Hlam. replace (lam * a, lam * b) with (scale lam (a, b)) by reflexivity.
  rewrite norm_scale by lra. pose proof (norm_pos (a, b)). nra.
Qed.

Lemma wheels_since_the_sample (S : setting) (r : robot) others k v_own w_low w_high t tau :
  sensible S -> guarded S others r -> 0 <= v_own -> w_low <= 0 <= w_high ->
  covers v_own w_low w_high (computed r k) ->
  covers_the_alive S r k v_own w_low w_high ->
  in_force (lifetime S) (mail r) t = Some (computed r k) ->
  stamp (computed r k) <= tau <= t ->
  norm (v r tau, side r tau) <= v_own /\ w_low <= w r tau <= w_high.
Proof.
  intros HS [_ [Hobey [Hchron [Hone [Hsent Hall]]]]] Hown Hw Hcov Halive Hforce Htau.
  destruct (Hall k) as [Hs0 _].
  destruct (Hobey tau ltac:(lra)) as [Hmax [Hspin Hdoes]].
  assert (Hpart : forall c, covers v_own w_low w_high c ->
    forall lam part, 0 <= lam <= 1 -> 0 <= part <= 1 -> v r tau = lam * speed c -> side r tau = lam * across c ->
    w r tau = part * turn c ->
    norm (v r tau, side r tau) <= v_own /\ w_low <= w r tau <= w_high).
  { intros c [C1 C2] lam part Hlam Hpart -> -> ->. split.
    - apply Rle_trans with (norm (speed c, across c)); [|exact C1].
      apply part_of_a_command. exact Hlam.
    - split; nra. }
  destruct (in_force (lifetime S) (mail r) tau) as [c'|] eqn:Hc'.
  - destruct Hdoes as [lam [Hlam [Hv [Hsd [part [Hprt Hwt]]]]]].
    destruct (who_acted_since_the_sample (lifetime S) (mail r) (computed r) t tau k c'
                Hchron Hone Hsent Hforce Htau Hc') as [-> | [l [Hlk [-> Hl]]]].
    + apply (Hpart (computed r k) Hcov lam part); assumption.
    + destruct (Halive l Hlk Hl) as [Hsame Hother].
      destruct (Nat.eq_dec (incarnation (computed r l)) (incarnation (computed r k))) as [E|E].
      * apply (Hpart (computed r l) (Hsame E) lam part); assumption.
      * destruct (Hother E) as [V1 [V2 V3]].
        split; lra.
  - destruct Hdoes as [-> [-> ->]].
    assert (norm (0, 0) = 0) as -> by (unfold norm, dot; simpl; rewrite !Rmult_0_l, Rplus_0_l; apply sqrt_0).
    lra.
Qed.
