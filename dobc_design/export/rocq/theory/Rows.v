(* Rows of the certificate: couplings that rise on an interval, sums of them from s = 0 on, and the faces of a box. *)
From Coquelicot Require Import Coquelicot.
Require Import Reals List Lra Lia.
From Dobc Require Import Statement Comparison Consensus.
Import ListNotations.
Open Scope R_scope.

(* P holds for every number below n if it holds for the members of the list 0, ..., n - 1. *)
Lemma all_below : forall (n : nat) (P : nat -> Prop), List.Forall P (List.seq 0 n) -> forall i, (i < n)%nat -> P i.
Proof.
  intros n P H i Hi. rewrite List.Forall_forall in H. apply H, List.in_seq. lia.
Qed.

(* h has the derivative h' on [lo, hi]. *)
Definition smooth (h h' : R -> R) (lo hi : R) : Prop := forall y, lo <= y <= hi -> is_derive h y (h' y).

(* A coupling whose derivative is at least 0 on [lo, hi] rises there. *)
Lemma rising : forall h h' lo hi, smooth h h' lo hi -> (forall y, lo <= y <= hi -> 0 <= h' y) ->
  forall a b, lo <= a -> a <= b -> b <= hi -> h a <= h b.
Proof.
  intros h h' lo hi D P a b Ha Hab Hb. destruct (Req_dec a b) as [->|N]; [lra|].
  destruct (MVT_cor2 h h' a b) as [c [E Hc]]; [lra| |].
  - intros c Hc. apply is_derive_Reals, D. lra.
  - assert (0 <= h' c) by (apply P; lra). nra.
Qed.

Lemma falling : forall h h' lo hi, smooth h h' lo hi -> (forall y, lo <= y <= hi -> h' y <= 0) ->
  forall a b, lo <= a -> a <= b -> b <= hi -> h b <= h a.
Proof.
  intros h h' lo hi D P a b Ha Hab Hb. destruct (Req_dec a b) as [->|N]; [lra|].
  destruct (MVT_cor2 h h' a b) as [c [E Hc]]; [lra| |].
  - intros c Hc. apply is_derive_Reals, D. lra.
  - assert (h' c <= 0) by (apply P; lra). nra.
Qed.

Lemma smooth_within : forall h h' lo hi a b, smooth h h' lo hi -> lo <= a -> b <= hi -> smooth h h' a b.
Proof. intros h h' lo hi a b D A B y Hy. apply D. lra. Qed.

(* One term of a row: weight, coupling, its derivative, and the step v_j - v_i. *)
Record term := Term { weight : R; fn : R -> R; slope : R -> R; step : R }.

Definition total (l : list term) (s : R) : R := fold_right (fun t r => weight t * fn t (s * step t) + r) 0 l.
Definition steepness (l : list term) (s : R) : R :=
  fold_right (fun t r => weight t * (step t * slope t (s * step t)) + r) 0 l.

Lemma total_derive : forall l s,
  Forall (fun t => is_derive (fn t) (s * step t) (slope t (s * step t))) l ->
  derivable_pt_lim (total l) s (steepness l s).
Proof.
  induction l as [|t l IH]; intros s H; simpl.
  - apply derivable_pt_lim_const.
  - inversion H as [|? ? D Hl]; subst.
    apply (derivable_pt_lim_plus (fun s => weight t * fn t (s * step t)) (total l)); [|exact (IH s Hl)].
    apply (derivable_pt_lim_scal (fun s => fn t (s * step t))).
    rewrite (Rmult_comm (step t)).
    apply (derivable_pt_lim_comp (fun s => s * step t) (fn t)); [|apply is_derive_Reals, D].
    apply is_derive_Reals. auto_derive; [exact I | ring].
Qed.

(* Near 0 the slopes decide: where the sum of weight (v_j - v_i) h' is at most c on [0, s0], the row is at most c s. *)
Lemma from_zero : forall l s0 c,
  Forall (fun t => smooth (fn t) (slope t) (Rmin 0 (s0 * step t)) (Rmax 0 (s0 * step t)) /\ fn t 0 = 0) l ->
  (forall s, 0 <= s <= s0 -> steepness l s <= c) ->
  forall s, 0 <= s <= s0 -> total l s <= c * s.
Proof.
  intros l s0 c H P s Hs.
  assert (Z : total l 0 = 0).
  { clear P. induction H as [|t l (_ & E) _ IH]; simpl; [reflexivity|]. rewrite IH, Rmult_0_l, E. ring. }
  destruct (Req_dec s 0) as [->|N]; [rewrite Z; lra|].
  destruct (MVT_cor2 (total l) (steepness l) 0 s) as [d [E Hd]]; [lra| |].
  - intros d Hd. apply total_derive. eapply Forall_impl; [|exact H].
    intros t (D & _). apply D. destruct (Rle_dec 0 (step t)).
    + rewrite Rmin_left, Rmax_right by nra. nra.
    + rewrite Rmin_right, Rmax_left by nra. nra.
  - assert (steepness l d <= c) by (apply P; lra). rewrite Z in E. nra.
Qed.

(* h mirrored, for the lower face. *)
Definition mirrored (h : R -> R) (y : R) : R := - h (- y).

Lemma mirrored_smooth : forall h h' lo hi, smooth h h' lo hi -> smooth (mirrored h) (fun y => h' (- y)) (- hi) (- lo).
Proof.
  intros h h' lo hi D y Hy. unfold mirrored. replace (h' (- y)) with (- (-1 * h' (- y))) by ring.
  apply @is_derive_opp.
  apply is_derive_Reals. rewrite (Rmult_comm (-1)).
  apply (derivable_pt_lim_comp (fun y => - y) h); [|apply is_derive_Reals, D; lra].
  apply (derivable_pt_lim_opp id y 1), derivable_pt_lim_id.
Qed.

(* From bounds of the single couplings to the row of an agent. *)
Lemma abs_between : forall a b, Rabs a <= b -> - b <= a <= b.
Proof. intros a b H. apply Rabs_le_between, H. Qed.

(* What an agent hears from one other: who speaks, the weight of the arc, its coupling, and a function of s that the
   coupling never exceeds on the face. *)
Record heard_arc := Heard { who : nat; factor : R; law : R -> R; most : R -> R }.

Definition sum_of (f : heard_arc -> R) (l : list heard_arc) : R := fold_right (fun t r => f t + r) 0 l.

Section Faces.
Variables (net : loop) (v k : nat -> R) (alpha : R) (p i : nat).

(* The two rows of agent i in mode p for all boxes s of [lo, hi]. *)
Definition upper_on (lo hi : R) : Prop := forall s e, 0 < s -> lo <= s -> s <= hi ->
  (forall j, (j < agents net)%nat -> Rabs (e j) <= s * v j) -> e i = s * v i ->
  row net p i e <= (k i - alpha) * s * v i.
Definition lower_on (lo hi : R) : Prop := forall s e, 0 < s -> lo <= s -> s <= hi ->
  (forall j, (j < agents net)%nat -> Rabs (e j) <= s * v j) -> e i = - (s * v i) ->
  - ((k i - alpha) * s * v i) <= row net p i e.

Lemma upper_join : forall a b c, upper_on a b -> upper_on b c -> upper_on a c.
Proof. intros a b c H G s e P A B E F. destruct (Rle_dec s b); [apply H | apply G]; auto; lra. Qed.
Lemma lower_join : forall a b c, lower_on a b -> lower_on b c -> lower_on a c.
Proof. intros a b c H G s e P A B E F. destruct (Rle_dec s b); [apply H | apply G]; auto; lra. Qed.

(* Each coupling is at most [most s] where its argument may be, and the sum of these is at most what the pin leaves. *)
Lemma upper_from : forall (l : list heard_arc) lo hi,
  (forall e, row net p i e = sum_of (fun t => factor t * law t (e (who t) - e i)) l) ->
  Forall (fun t => (who t < agents net)%nat /\ 0 <= factor t /\ forall s y, 0 < s -> lo <= s -> s <= hi ->
    - (s * (v (who t) + v i)) <= y -> y <= s * (v (who t) - v i) -> law t y <= most t s) l ->
  (forall s, 0 < s -> lo <= s -> s <= hi -> sum_of (fun t => factor t * most t s) l <= (k i - alpha) * s * v i) ->
  upper_on lo hi.
Proof.
  intros l lo hi R0 B S s e P A Z E F. rewrite R0. eapply Rle_trans; [|exact (S s P A Z)].
  clear R0 S. induction B as [|t l (J & W & M) _ IH]; simpl; [lra|].
  assert (T : law t (e (who t) - e i) <= most t s).
  { specialize (E (who t) J). apply abs_between in E. apply M; auto; rewrite F; lra. }
  assert (factor t * law t (e (who t) - e i) <= factor t * most t s) by (apply Rmult_le_compat_l; auto). lra.
Qed.
Lemma lower_from : forall (l : list heard_arc) lo hi,
  (forall e, row net p i e = sum_of (fun t => factor t * law t (e (who t) - e i)) l) ->
  Forall (fun t => (who t < agents net)%nat /\ 0 <= factor t /\ forall s y, 0 < s -> lo <= s -> s <= hi ->
    - (s * (v (who t) + v i)) <= y -> y <= s * (v (who t) - v i) -> mirrored (law t) y <= most t s) l ->
  (forall s, 0 < s -> lo <= s -> s <= hi -> sum_of (fun t => factor t * most t s) l <= (k i - alpha) * s * v i) ->
  lower_on lo hi.
Proof.
  intros l lo hi R0 B S s e P A Z E F. rewrite R0.
  enough (- sum_of (fun t => factor t * law t (e (who t) - e i)) l <= (k i - alpha) * s * v i) by lra.
  eapply Rle_trans; [|exact (S s P A Z)].
  clear R0 S. induction B as [|t l (J & W & M) _ IH]; simpl; [lra|].
  assert (T : - law t (e (who t) - e i) <= most t s).
  { specialize (E (who t) J). apply abs_between in E. specialize (M s (- (e (who t) - e i)) P A Z).
    unfold mirrored in M. rewrite Ropp_involutive in M. apply M; rewrite F; lra. }
  assert (factor t * - law t (e (who t) - e i) <= factor t * most t s) by (apply Rmult_le_compat_l; auto). lra.
Qed.
End Faces.
