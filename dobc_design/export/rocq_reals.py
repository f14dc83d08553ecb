"""The lemma of ``rocq_lemmas`` for real vectors, with the axioms of the reals of Coq's standard library."""

from __future__ import annotations

OVER_R = r"""
Import Lra.
Open Scope R_scope.

Lemma sum_R_equal : forall k f g, (forall i, (i < k)%nat -> f i = g i) -> sum_R k f = sum_R k g.
Proof.
  induction k as [|k IH]; intros f g H; simpl; [reflexivity|].
  rewrite (IH f g) by (intros; apply H; lia). rewrite (H k) by lia. reflexivity.
Qed.

Lemma sum_R_add : forall k f g, sum_R k (fun i => f i + g i) = sum_R k f + sum_R k g.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_R_scale : forall k a f, sum_R k (fun i => a * f i) = a * sum_R k f.
Proof. induction k as [|k IH]; intros; simpl; [ring | rewrite IH; ring]. Qed.

Lemma sum_R_zero : forall k f, (forall i, (i < k)%nat -> f i = 0) -> sum_R k f = 0.
Proof.
  induction k as [|k IH]; intros f H; simpl; [reflexivity|].
  rewrite IH by (intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma sum_R_single : forall k f p, (p < k)%nat ->
  (forall i, (i < k)%nat -> i <> p -> f i = 0) -> sum_R k f = f p.
Proof.
  induction k as [|k IH]; intros f p Hp H; [lia|]. simpl.
  destruct (Nat.eq_dec p k) as [E|E].
  - subst. rewrite sum_R_zero by (intros; apply H; lia). ring.
  - rewrite (IH f p) by (try lia; intros; apply H; lia). rewrite (H k) by lia. ring.
Qed.

Lemma Q2R_zero : Q2R 0 = 0.
Proof. unfold Q2R. simpl. ring. Qed.

Lemma Q2R_one : Q2R 1 = 1.
Proof. unfold Q2R. simpl. field. Qed.

Lemma Q2R_positive : forall a, (0 < a)%Q -> 0 < Q2R a.
Proof. intros a H. rewrite <- Q2R_zero. apply Qlt_Rlt. exact H. Qed.

Lemma form_R_equal : forall k M N x,
  (forall i j, (i < k)%nat -> (j < k)%nat -> (M i j == N i j)%Q) -> form_R k M x = form_R k N x.
Proof.
  intros k M N x H. unfold form_R. apply sum_R_equal. intros i Hi. apply sum_R_equal. intros j Hj.
  rewrite (Qeq_eqR _ _ (H i j Hi Hj)). reflexivity.
Qed.

Lemma form_R_negated : forall k M x, form_R k (fun i j => (- M i j)%Q) x = - form_R k M x.
Proof.
  intros k M x. unfold form_R.
  rewrite (sum_R_equal k _ (fun i => (-1) * sum_R k (fun j => x i * Q2R (M i j) * x j))).
  - rewrite sum_R_scale. ring.
  - intros i _. rewrite <- sum_R_scale. apply sum_R_equal. intros. rewrite Q2R_opp. ring.
Qed.

Definition value_R (k : nat) (x : nat -> R) (s : square) : R := sum_R k (fun i => Q2R (column s i) * x i).

Definition squares_R (k : nat) (l : list square) (x : nat -> R) : R :=
  fold_right (fun s v => Q2R (weight s) * (value_R k x s * value_R k x s) + v) 0 l.

Lemma form_R_product : forall k l x, form_R k (product l) x = squares_R k l x.
Proof.
  intros k l x. induction l as [|s rest IH].
  - unfold form_R. apply sum_R_zero. intros. apply sum_R_zero. intros. cbn [product]. rewrite Q2R_zero. ring.
  - rewrite (form_R_equal k _ (fun i j => weight s * (column s i * column s j) + product rest i j)%Q)
      by (intros; apply product_step).
    unfold squares_R. cbn [fold_right]. fold (squares_R k rest x). rewrite <- IH. unfold form_R.
    rewrite (sum_R_equal k _ (fun i => Q2R (weight s) * value_R k x s * (Q2R (column s i) * x i)
      + sum_R k (fun j => x i * Q2R (product rest i j) * x j))).
    + rewrite sum_R_add, sum_R_scale. unfold value_R. ring.
    + intros i _. rewrite (sum_R_equal k _ (fun j =>
        (Q2R (weight s) * (Q2R (column s i) * x i)) * (Q2R (column s j) * x j)
        + x i * Q2R (product rest i j) * x j)).
      * rewrite sum_R_add, sum_R_scale. unfold value_R. ring.
      * intros j _. rewrite Q2R_plus, !Q2R_mult. ring.
Qed.

Lemma squares_R_nonnegative : forall k l x, triangular k l = true -> 0 <= squares_R k l x.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H; [apply Rle_refl|].
  destruct (triangular_step k s rest H) as [_ [D [_ T]]]. specialize (IH T).
  apply Q2R_positive in D. unfold squares_R in *. cbn [fold_right]. nra.
Qed.

Lemma squares_R_vanish : forall k l x, triangular k l = true -> squares_R k l x <= 0 ->
  forall i, In i (map pivot l) -> x i = 0.
Proof.
  intros k l x. induction l as [|s rest IH]; intros H Z i Hi; [destruct Hi|].
  destruct (triangular_step k s rest H) as [Hp [D [Later T]]]. apply Q2R_positive in D.
  pose proof (squares_R_nonnegative k rest x T) as N.
  assert (Zr : squares_R k rest x <= 0) by (unfold squares_R in *; cbn [fold_right] in Z; nra).
  assert (Zs : value_R k x s = 0).
  { assert (S : Q2R (weight s) * (value_R k x s * value_R k x s) <= 0)
      by (unfold squares_R in *; cbn [fold_right] in Z; lra).
    apply Rsqr_0_uniq. unfold Rsqr. nra. }
  specialize (IH T Zr). cbn [map] in Hi.
  assert (X : x (pivot s) = 0).
  { unfold value_R in Zs. rewrite (sum_R_single k _ (pivot s) Hp) in Zs.
    - unfold column in Zs. rewrite Nat.eqb_refl in Zs. rewrite Q2R_one, Rmult_1_l in Zs. exact Zs.
    - intros j Hj Other. destruct (Later j Hj) as [E|[E|E]]; [contradiction| |].
      + rewrite (IH j E). ring.
      + rewrite (Qeq_eqR _ _ E), Q2R_zero. ring. }
  destruct Hi as [E|E]; [rewrite <- E; exact X | exact (IH i E)].
Qed.

Theorem check_positive_R : forall k M l, check k M l = true -> positive_definite_R k M.
Proof.
  intros k M l H x [i [Hi N]]. unfold check in H.
  apply andb_prop in H. destruct H as [H E]. apply andb_prop in H. destruct H as [T Pivots].
  rewrite (form_R_equal k M (product l) x (same_spec k M (product l) E)).
  rewrite form_R_product. apply Rnot_le_lt. intros Z. apply N.
  apply (squares_R_vanish k l x T Z). apply member_in. exact (all_below_spec k _ Pivots i Hi).
Qed.

Theorem check_negative_R : forall k M l,
  check k (fun i j => (- M i j)%Q) l = true -> negative_definite_R k M.
Proof.
  intros k M l H x N. pose proof (check_positive_R k _ l H x N) as G. rewrite form_R_negated in G. lra.
Qed.

Lemma derivative_negative_R : forall k F V S, check_derivative k F V S = true -> negative_definite_R k S ->
  negative_definite_R k (fun i j => sum k (fun h => F h i * V h j + V i h * F h j)%Q).
Proof.
  intros k F V S E H x X. rewrite <- (form_R_equal k S _ x (derivative_spec k F V S E)). exact (H x X).
Qed.

Close Scope R_scope.
"""
