(** The plant's rule for commands, as implemented by `World::accept_command` and `World::advance` of plant/src/world.rs:
    the newest accepted command is in effect until the stamp of the sample it answers + H; late and old commands
    are refused; without a command in force the robot is at rest.

    Messages are arbitrary: any message may be lost, delayed, repeated or overtaken, at any time. *)

Require Import Reals Lra Psatz Lia.
Open Scope R_scope.

(** Times in s, speeds in m/s, turn rates in rad/s. *)
Record command := Command {
  incarnation : nat;   (* incarnation of the process that sent it *)
  stamp : R;           (* stamp of the odometry sample that it answers *)
  sequence : nat;
  speed : R;           (* forward speed of the controlled point, m/s *)
  across : R;          (* speed of the controlled point to the left, m/s *)
  turn : R             (* w *)
}.

(** The key (incarnation, stamp, sequence) of [a] precedes that of [b]: the tuple order in `accept`. *)
Definition before (a b : command) : Prop :=
  (incarnation a < incarnation b)%nat \/
  (incarnation a = incarnation b /\
   (stamp a < stamp b \/ (stamp a = stamp b /\ (sequence a < sequence b)%nat))).

Lemma before_trans a b c : before a b -> before b c -> before a c.
Proof.
  unfold before. intros Hab Hbc.
  destruct Hab as [Hab|[Hab [Hab'|[Hab' Hab'']]]]; destruct Hbc as [Hbc|[Hbc [Hbc'|[Hbc' Hbc'']]]];
    try (left; lia); right; (split; [lia|]); try (left; lra); right; split; [lra|lia].
Qed.

Lemma before_irrefl a : ~ before a a.
Proof.
  unfold before. intros [H|[_ [H|[_ H]]]]; [lia|lra|lia].
Qed.

Definition before_dec (a b : command) : {before a b} + {~ before a b}.
Proof.
  unfold before.
  destruct (Compare_dec.lt_eq_lt_dec (incarnation a) (incarnation b)) as [[H|H]|H].
  - left. left. exact H.
  - destruct (total_order_T (stamp a) (stamp b)) as [[S|S]|S].
    + left. right. auto.
    + destruct (Compare_dec.lt_dec (sequence a) (sequence b)) as [Q|Q].
      * left. right. auto.
      * right. intros [X|[_ [X|[_ X]]]]; [lia|lra|lia].
    + right. intros [X|[_ [X|[X _]]]]; [lia|lra|lra].
  - right. intros [X|[X _]]; lia.
Defined.

(** ** `World::accept_command`: the value of `newest_command_key` after the message [c] was received at [now].

    H is the command timeout. An implausible message changes nothing either: here it counts as lost. *)
Definition accept (H now : R) (c : command) (newest : option command) : option command :=
  if Rle_dec (stamp c) now then
    if Rlt_dec now (stamp c + H) then
      match newest with
      | None => Some c
      | Some n => if before_dec n c then Some c else newest
      end
    else newest
  else newest.

(** ** Messages that the plant receives from one robot: message n is received at the time [taken n]. *)
Record mailbox := Mailbox {
  message : nat -> command;
  taken : nat -> R;
  count : R -> nat     (* number of messages received until t, t included *)
}.

Definition chronological (m : mailbox) : Prop :=
  forall n t, (n < count m t)%nat <-> taken m n <= t.

Fixpoint newest (H : R) (m : mailbox) (n : nat) : option command :=
  match n with
  | O => None
  | S n => accept H (taken m n) (message m n) (newest H m n)
  end.

(** ** `World::advance`: the command in effect at t, until its stamp + H. *)
Definition in_force (H : R) (m : mailbox) (t : R) : option command :=
  match newest H m (count m t) with
  | Some c => if Rlt_dec t (stamp c + H) then Some c else None
  | None => None
  end.

(** ** Consequences. *)

Lemma newest_was_taken H m n c :
  newest H m n = Some c ->
  exists k, (k < n)%nat /\ message m k = c /\ stamp c <= taken m k < stamp c + H.
Proof.
  induction n as [|n IH]; simpl; [discriminate|]. unfold accept.
  assert (Hold : newest H m n = Some c ->
    exists k, (k < S n)%nat /\ message m k = c /\ stamp c <= taken m k < stamp c + H).
  { intros Hc. destruct (IH Hc) as [k [Hk R]]. exists k. split; [lia|exact R]. }
  destruct (Rle_dec (stamp (message m n)) (taken m n)) as [H1|]; [|exact Hold].
  destruct (Rlt_dec (taken m n) (stamp (message m n) + H)) as [H2|]; [|exact Hold].
  assert (Hnew : Some (message m n) = Some c ->
    exists k, (k < S n)%nat /\ message m k = c /\ stamp c <= taken m k < stamp c + H).
  { intros E. injection E as E. exists n. subst c. split; [lia|]. split; [reflexivity|lra]. }
  destruct (newest H m n) as [n0|]; [|exact Hnew].
  destruct (before_dec n0 (message m n)); [exact Hnew|exact Hold].
Qed.

Lemma newest_only_grows H m n n' c :
  (n <= n')%nat -> newest H m n = Some c ->
  exists c', newest H m n' = Some c' /\ (c = c' \/ before c c').
Proof.
  intros Hn Hc. induction Hn as [|n' Hn IH]; [exists c; auto|].
  destruct IH as [c1 [H1 B1]]. simpl. unfold accept. rewrite H1.
  assert (Hkeep : exists c', Some c1 = Some c' /\ (c = c' \/ before c c')) by (exists c1; auto).
  destruct (Rle_dec _ _); [|exact Hkeep]. destruct (Rlt_dec _ _); [|exact Hkeep].
  destruct (before_dec c1 (message m n')) as [B|]; [|exact Hkeep].
  exists (message m n'). split; [reflexivity|]. right.
  destruct B1 as [->|B1]; [exact B|apply (before_trans c c1); assumption].
Qed.

Lemma count_only_grows m t t' :
  chronological m -> t <= t' -> (count m t <= count m t')%nat.
Proof.
  intros Hm Ht. destruct (Compare_dec.le_lt_dec (count m t) (count m t')) as [|Hlt]; [assumption|].
  exfalso. apply (proj1 (Hm _ _)) in Hlt.
  assert (taken m (count m t') <= t') as Hle by lra.
  apply (proj2 (Hm _ _)) in Hle. lia.
Qed.

(** A command is in effect only from its stamp to its stamp + H. *)
Theorem acts_within_its_lifetime H m t c :
  chronological m -> in_force H m t = Some c ->
  stamp c <= t < stamp c + H /\ exists n, message m n = c.
Proof.
  intros Hm. unfold in_force. destruct (newest H m (count m t)) as [n|] eqn:Hn; [|discriminate].
  destruct (Rlt_dec t (stamp n + H)) as [Hlt|]; [|discriminate].
  intros E. injection E as E. subst n.
  destruct (newest_was_taken _ _ _ _ Hn) as [k [Hk [Hmsg Hst]]].
  assert (taken m k <= t).
  { apply (Hm k t). exact Hk. }
  split; [lra|]. exists k. exact Hmsg.
Qed.

(** Later, only the same command or one that comes after it is in effect. *)
Theorem acts_in_order H m t t' c c' :
  chronological m -> t <= t' ->
  in_force H m t = Some c -> in_force H m t' = Some c' -> c = c' \/ before c c'.
Proof.
  intros Hm Ht. unfold in_force.
  destruct (newest H m (count m t)) as [n|] eqn:Hn; [|discriminate].
  destruct (Rlt_dec t (stamp n + H)); [|discriminate]. intros E. injection E as ->.
  destruct (newest_only_grows H m _ _ c (count_only_grows m t t' Hm Ht) Hn) as [c1 [H1 B1]].
  rewrite H1. destruct (Rlt_dec t' (stamp c1 + H)); [|discriminate].
  intros E. injection E as ->. exact B1.
Qed.

(** ** All commands that the processes of one robot ever compute, in order.

    [computed k] comes before [computed l] for k < l, and answers no later sample: one incarnation lives at a
    time, receives the newest sample, and counts its answers. *)
Definition one_living_incarnation (computed : nat -> command) : Prop :=
  forall k l, (k < l)%nat ->
  before (computed k) (computed l) /\ stamp (computed k) <= stamp (computed l).

(** No other process commands the robot. *)
Definition sent_by (computed : nat -> command) (m : mailbox) : Prop :=
  forall n, exists k, message m n = computed k.

Lemma incarnations_in_order computed k l :
  one_living_incarnation computed -> (k <= l)%nat ->
  (incarnation (computed k) <= incarnation (computed l))%nat.
Proof.
  intros Hone Hkl. destruct (Compare_dec.le_lt_eq_dec _ _ Hkl) as [Hlt|Heq]; [|subst; lia].
  destruct (Hone k l Hlt) as [[B|[B _]] _]; lia.
Qed.

(** Between the sample of a command and the instants at which it is in effect, only this command and those
    computed before it are in effect, and of the latter only those that were unexpired at the sample. *)
Theorem who_acted_since_the_sample H m computed t tau k c' :
  chronological m -> one_living_incarnation computed -> sent_by computed m ->
  in_force H m t = Some (computed k) ->
  stamp (computed k) <= tau <= t -> in_force H m tau = Some c' ->
  c' = computed k \/
  exists l, (l < k)%nat /\ c' = computed l /\ stamp (computed k) < stamp (computed l) + H.
Proof.
  intros Hm Hone Hsent Ht Htau Hc'.
  destruct (acts_within_its_lifetime H m tau c' Hm Hc') as [Hlife [n Hn]].
  destruct (Hsent n) as [l Hl]. rewrite Hn in Hl. clear n Hn. rewrite Hl in *. clear c' Hl.
  destruct (Compare_dec.lt_eq_lt_dec l k) as [[Hlt| ->]|Hgt].
  - right. exists l. split; [exact Hlt|]. split; [reflexivity|lra].
  - left. reflexivity.
  - exfalso. destruct (Hone k l Hgt) as [B _].
    destruct (acts_in_order H m tau t _ _ Hm (proj2 Htau) Hc' Ht) as [E|B'].
    + rewrite E in B. apply (before_irrefl _ B).
    + apply (before_irrefl (computed k)). apply (before_trans _ (computed l)); assumption.
Qed.
